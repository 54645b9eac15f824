// Pinchmaps in any view: projective maps, deep zooms, any number of mip levels, anisotropic probes, patches.
// Included by pinchmap.glsl. Provides pinchmap_record_sample.
//
// The four texels around a place are fetched one by one and interpolated here, in float32 and relative to a texel near what
// is seen, so that an edge is placed right at any magnification; that also gives the gradient across it without differences
// between pixels, so that this may be called in a loop.
//
// A filter that reads prefiltered images reads those of the picture as a whole (image.glsl), discontinuities and lines
// included, where nothing is displaced any more; as the displacement fades, that lookup is blended in.
//
// Defines: PINCHMAP_PROBES 1 for anisotropic filtering, PINCHMAP_MIXED 1 where not all may take as many probes;
// PINCHMAP_LINES 1 where any has a solid line; PINCHMAP_FILTERED 1 where any picture is looked up as a whole,
// PINCHMAP_WARPED 0 where nothing else is.
//
// Record, written by fexel/textures/pinchmap_gpu.py:
//   0  position.x * w - base.x * w from (s, t, 1), h
//   1  position.y * w - base.y * w, antialias
//   2  w, line width
//   3  size of the pinchmap, base
//   4  page texel of position (0, 0), codes = wrap mode along s + 4 * along t + 16 in the float pages + 32 signal in the
//      half-float pages + 64 a patch; finest + 16 * coarsest mip level of the signal
//   5  line colour, premultiplied
//   6  log2 of signal texels per pinchmap texel; 0 where one texel stands for the whole pinchmap, else 1; record of the
//      picture as a whole, -1 where it is not looked up; most probes
//   7  per level: scale.xy, offset.xy from position to page coordinates
#if PINCHMAP_RECORDS

#define PINCHMAP_HEADER 7

uniform float pinchmapMaxProbes;
uniform float pinchmapImageProbes;   // most that image.glsl may take

struct PinchmapPlace {
    vec2 cell;        // lowest of the four texels around
    vec2 fraction;    // within them
    vec2 direction;   // of the wrapped position along the position: 1, -1 where mirrored, 0 where clamped
};

// Along one axis. relative + base is the position; whole texels are split off so that the fraction keeps its digits.
vec3 pinchmap_locate(float relative, float base, float size, int mode)
{
    float whole = floor(relative);
    float cell = base + whole;
    float fraction = relative - whole;
    float period = floor(cell / size);
    float repeated = cell - size * period;
    if (mode == PINCHMAP_REPEAT)
        return vec3(repeated, fraction, 1.0);
    bool odd = mod(period, 2.0) == 1.0;
    if (mode == PINCHMAP_MIRROR)
        return odd ? vec3(size - 1.0 - repeated, 1.0 - fraction, -1.0) : vec3(repeated, fraction, 1.0);
    bool below = cell < 0.0;
    bool above = cell >= size;
    return vec3(clamp(cell, 0.0, size - 1.0), below ? 0.0 : above ? 1.0 : fraction, below || above ? 0.0 : 1.0);
}

vec4 pinchmap_record_texel(ivec2 page, bool isFloat)
{
#if PINCHMAP_SNORM && PINCHMAP_FLOAT
    if (isFloat)
        return texelFetch(pagesFloat, page, 0);
    return texelFetch(pagesSnorm, page, 0);
#elif PINCHMAP_FLOAT
    return texelFetch(pagesFloat, page, 0);
#else
    return texelFetch(pagesSnorm, page, 0);
#endif
}

// One level of the signal; beyond its edge the lookup stops at the border texel.
vec4 pinchmap_level(int record, vec2 place, vec2 size, bool isHalf)
{
    vec4 level = record_fetch(record);
    vec2 halfTexel = pageHalfTexel[isHalf ? PAGE_HALF : PAGE_SRGB].xy;
    vec2 begin = level.zw;
    vec2 end = size * level.xy + level.zw;
    vec2 page = place * level.xy + level.zw;
    return pinchmap_signal(clamp(page, min(begin, end) - halfTexel, max(begin, end) + halfTexel), isHalf);
}

vec4 pinchmap_record_sample(int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    vec4 rowX = record_fetch(record);
    vec4 rowY = record_fetch(record + 1);
    vec4 rowW = record_fetch(record + 2);
    vec4 sizes = record_fetch(record + 3);
    vec4 page = record_fetch(record + 4);
    vec2 size = sizes.xy;
    int codes = int(page.z);
    int levels = int(page.w);
    ivec2 wrap = ivec2(codes & 3, (codes >> 2) & 3);
    bool isFloat = (codes & 16) != 0;
    bool isHalf = (codes & 32) != 0;
    bool isPatch = (codes & 64) != 0;

    vec3 mapped = vec3(dot(rowX.xyz, vec3(st, 1.0)), dot(rowY.xyz, vec3(st, 1.0)), dot(rowW.xyz, vec3(st, 1.0)));
    vec2 middle = mapped.xy / mapped.z;
    // Exact Jacobian of the projective map: d(xy / w) = (d(xy) - xy / w d(w)) / w.
    vec2 dx = (vec2(dot(rowX.xy, dstdx), dot(rowY.xy, dstdx)) - middle * dot(rowW.xy, dstdx)) / mapped.z;
    vec2 dy = (vec2(dot(rowX.xy, dstdy), dot(rowY.xy, dstdy)) - middle * dot(rowW.xy, dstdy)) / mapped.z;
    vec4 scales = record_fetch(record + 6);
#if PINCHMAP_PROBES
#if PINCHMAP_MIXED
    float most = scales.w;
#else
    float most = pinchmapMaxProbes;
#endif
    Footprint axes = make_footprint(dx, dy);
    float probes = footprint_probes(axes, most);
    float width = footprint_level(axes, most);
#else
    float width = isotropic_level(dx, dy);
#endif
    lod = width + scales.x;
    float used = clamp(lod, float(levels & 15), float(levels >> 4));
    int fine = int(used);
    int fineLevel = record + PINCHMAP_HEADER + fine - (levels & 15);
    int coarseLevel = record + PINCHMAP_HEADER + min(fine + 1, levels >> 4) - (levels & 15);
    float footprint = exp2(width);

    vec4 sum = vec4(0.0);
#if PINCHMAP_FILTERED
    float whole = scales.z < 0.0 ? 0.0 : scales.y == 0.0 ? 1.0 : 1.0 - pinch_fade(footprint);
    footprint = scales.z < 0.0 ? footprint : min(footprint, 1.0);  // the blend takes the place of the fade
#endif
#if PINCHMAP_WARPED
    // A transition is as wide as the share of the footprint that each probe covers.
    vec2 ddx = dx;
    vec2 ddy = dy;
#if PINCHMAP_PROBES
    float weight = 1.0 / probes;
    vec2 shorten = axes.majorDirection * ((1.0 - weight) / (axes.majorAxis * axes.majorAxis));
    ddx -= dot(axes.majorDirection, dx) * shorten;
    ddy -= dot(axes.majorDirection, dy) * shorten;
    float along = 0.5 * weight - 0.5;
    do {
        vec2 relative = middle + along * axes.majorDirection;
#else
        vec2 relative = middle;
#endif
        vec3 s = pinchmap_locate(relative.x, sizes.z, size.x, wrap.x);
        vec3 t = pinchmap_locate(relative.y, sizes.w, size.y, wrap.y);
        vec2 cell = vec2(s.x, t.x);
        vec2 fraction = vec2(s.y, t.y);
        vec2 direction = vec2(s.z, t.z);
        ivec2 texelPlace = ivec2(page.x + scales.y * cell.x, page.y - scales.y * cell.y);
        vec2 gradient;
        vec4 texel = pinch_bilinear(pinchmap_record_texel(texelPlace, isFloat),
                                    pinchmap_record_texel(texelPlace + ivec2(1, 0), isFloat),
                                    pinchmap_record_texel(texelPlace + ivec2(0, -1), isFloat),
                                    pinchmap_record_texel(texelPlace + ivec2(1, -1), isFloat),
                                    fraction, direction * ddx, direction * ddy, gradient);
        vec2 offset = pinch_displace(texel, fraction, gradient, rowX.w, rowY.w, footprint);
        // Where the signal is clamped its own border decides, as far out as the place is.
        vec2 place = vec2(direction.x == 0.0 ? sizes.z + relative.x : cell.x + fraction.x,
                          direction.y == 0.0 ? sizes.w + relative.y : cell.y + fraction.y) + offset;
        place = vec2(wrap.x == PINCHMAP_BLACK ? place.x : pinchmap_wrap(place.x, size.x, wrap.x),
                     wrap.y == PINCHMAP_BLACK ? place.y : pinchmap_wrap(place.y, size.y, wrap.y));
        vec4 color = mix(pinchmap_level(fineLevel, place, size, isHalf), pinchmap_level(coarseLevel, place, size, isHalf),
                         used - float(fine));
#if PINCHMAP_LINES
        float coverage = pinch_line(texel, fraction, gradient, dx, dy, rowW.w, rowY.w, footprint);
        bool inside = (wrap.x != PINCHMAP_BLACK || direction.x != 0.0) && (wrap.y != PINCHMAP_BLACK || direction.y != 0.0);
        color = pinchmap_over(color, record_fetch(record + 5), inside && rowW.w > 0.0 ? coverage : 0.0);
#endif
        sum += color;
#if PINCHMAP_PROBES
        along += weight;
    } while (along < 0.5);
    sum *= weight;
    LOOKUP_COUNT(12.0 / weight);
#else
    LOOKUP_COUNT(12.0);
#endif
#endif
#if PINCHMAP_FILTERED
    if (whole > 0.0) {
        float filteredLod;
        vec4 filtered = image_filter(image_open(int(scales.z)), (middle + sizes.zw) / size, dx / size, dy / size,
                                     pinchmapImageProbes, filteredLod);
        sum += whole * (filtered - sum);
        lod = whole > 0.5 ? filteredLod : lod;
    }
#endif
    // The rim of a patch fades over one pixel inside of it.
    vec2 fromRim = min(middle + sizes.zw, size - middle - sizes.zw);
    vec2 pixel = vec2(length(vec2(dx.x, dy.x)), length(vec2(dx.y, dy.y)));
    vec2 ramp = clamp(fromRim / max(pixel, vec2(1e-30)), vec2(0.0), vec2(1.0));  // 1e-30 guards a constant st
    vec2 shown = rowY.w > 0.0 ? ramp : step(vec2(0.0), fromRim);
    return sum * (isPatch ? shown.x * shown.y : 1.0);
}
#endif
