// Umbrella textures (Just-in-time texture synthesis 2012): a few patches, many times placed and varied, composed per pixel.
// Requires texture_data.glsl, common_footprint.glsl, common_wrap.glsl, image.glsl. Provides umbrella_sample, umbrella_nested.
//
// Defines: UMBRELLA_SLOTS textures of the material; UMBRELLA_DRAWN 1 where the view sees umbrellas, UMBRELLA_PICTURE 1 where
// it sees a prefiltered level; UMBRELLA_PROBES 1 for anisotropic filtering; and what the umbrellas of any slot use:
// UMBRELLA_SHADOWS, UMBRELLA_COLORS vertex colours, UMBRELLA_ALPHA images with alpha, UMBRELLA_COVERAGES below 1,
// UMBRELLA_VECTORS, UMBRELLA_SCALED a scale or bias, UMBRELLA_OUTSIDE a wrap mode black, UMBRELLA_PERSPECTIVE a projective map
// to st; see also umbrella_search.glsl.
//
// Record, written by fexel/textures/umbrella_binding.py:
//   0  position.x * w from (s, t, 1) in cells of the arrangement, less base.x * w; base.x
//   1  position.y ...; base.y
//   2  cells along s, t; cells of the authored grid per cell, along s, t
//   3  page texels of the first texel: of the float page, of the half page
//   4  bins and slices of the tables; colour blend; codes = wrap mode along s + 4 * along t + 16 * log2 of a row of the float
//      page's texels + 512 * log2 of one of the half page's
//   5  shadow offset in cells; strength; record of the first base image
//   6  records of the background and of the level's image; texels of the record of a base image; address of the umbrellas
//   7  w from (s, t, 1)
//   8  level of the level's image, and how many levels it is blended in over
//   9  scale
//  10  bias
// The first UMBRELLA_CONSTANTS also come as flat varyings, from UMBRELLA_FLAT on, for the first UMBRELLA_FLATS textures of the
// material: llvmpipe reads them for a fraction of what a fetch costs.
//
// An `if` around a fetch saves nothing on llvmpipe: hits are searched by arithmetic, then shaded. Loops are do-while, and what
// is read after them is assigned only while a pixel is running (see zipmap_tree.glsl).
#include "texture_data.glsl"
#include "common_footprint.glsl"
#include "common_wrap.glsl"
#include "image.glsl"
#include "umbrella_search.glsl"
#include "umbrella_compose.glsl"

uniform ivec4 umbrellaRecord[UMBRELLA_SLOTS];
uniform float umbrellaMaxProbes;

const float UMBRELLA_FIRST_LEVEL = 0.125;    // cells per pixel up to which umbrellas are seen alone (section 6.3)

// place: of the record, or number of the texture where its constants are flat; which of the two is known when compiled.
vec4 umbrella_constant(bool isFlat, int place, int index)
{
#if UMBRELLA_FLATS
    if (isFlat)
        return textureFlat[UMBRELLA_FLAT + UMBRELLA_CONSTANTS * place + index];
#endif
    return record_fetch(place + index);
}

vec4 umbrella_lookup(bool isFlat, int place, int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    vec4 rowX = umbrella_constant(isFlat, place, 0);
    vec4 rowY = umbrella_constant(isFlat, place, 1);
    vec4 sizes = umbrella_constant(isFlat, place, 2);
    UmbrellaLook look = umbrella_look(sizes.xy, umbrella_constant(isFlat, place, 3), umbrella_constant(isFlat, place, 4),
                                      umbrella_constant(isFlat, place, 5), umbrella_constant(isFlat, place, 6));
    vec2 middle = vec2(dot(rowX.xy, st) + rowX.z, dot(rowY.xy, st) + rowY.z);
    vec2 dx = vec2(dot(rowX.xy, dstdx), dot(rowY.xy, dstdx));
    vec2 dy = vec2(dot(rowX.xy, dstdy), dot(rowY.xy, dstdy));
#if UMBRELLA_PERSPECTIVE
    // Exact Jacobian of the projective map: d(xy / w) = (d(xy) - xy / w d(w)) / w.
    vec4 rowW = record_fetch(record + 7);
    float w = dot(rowW.xy, st) + rowW.z;
    middle /= w;
    dx = (dx - middle * dot(rowW.xy, dstdx)) / w;
    dy = (dy - middle * dot(rowW.xy, dstdy)) / w;
#endif
    ivec2 wrap = look.wrap;

    vec4 color = vec4(0.0);
    vec2 ddx = dx;
    vec2 ddy = dy;
    lod = 0.0;
    patchIndex = -1.0;
#if UMBRELLA_PROBES
    Footprint axes = make_footprint(dx * sizes.zw, dy * sizes.zw);
    float probes = footprint_probes(axes, umbrellaMaxProbes);
    float level = footprint_level(axes, umbrellaMaxProbes);
    float weight = 1.0 / probes;
    // Each probe covers its share of the major axis.
    vec2 major = axes.majorDirection / sizes.zw;
    vec2 shorten = axes.majorDirection * ((1.0 - weight) / (axes.majorAxis * axes.majorAxis));
    ddx -= major * dot(shorten, dx * sizes.zw);
    ddy -= major * dot(shorten, dy * sizes.zw);
#else
    float level = isotropic_level(dx * sizes.zw, dy * sizes.zw);
#endif
    level -= log2(UMBRELLA_FIRST_LEVEL);

#if UMBRELLA_DRAWN
#if UMBRELLA_PROBES
    float along = 0.5 * weight - 0.5;
    bool isFirst = true;
    do {
        float probeLod;
        float probePatch;
        vec2 relative = middle + along * major;
        vec4 probe = umbrella_compose(look, relative, vec2(rowX.w, rowY.w), ddx, ddy, probeLod, probePatch);
        bool running = along < 0.5;
        color += running ? weight * probe : vec4(0.0);
        // The probe in the middle, or the one just before it, tells what is seen.
        bool tells = running && along <= 0.0;
        lod = tells ? probeLod : lod;
        patchIndex = tells ? probePatch : patchIndex;
        along += weight;
    } while (along < 0.5);
#else
    color = umbrella_compose(look, middle, vec2(rowX.w, rowY.w), ddx, ddy, lod, patchIndex);
#endif
#endif

#if UMBRELLA_PICTURE
    vec4 blending = record_fetch(record + 8);
    vec3 s = wrap_locate(middle.x, rowX.w, sizes.x, wrap.x);
    vec3 t = wrap_locate(middle.y, rowY.w, sizes.y, wrap.y);
    float pictureLod;
    vec2 uv = vec2(s.x + s.y, t.x + t.y) / sizes.xy;
    vec4 picture = image_sample(look.picture, uv, dx / sizes.xy, dy / sizes.xy, umbrellaMaxProbes, pictureLod);
#if UMBRELLA_DRAWN
    float blend = clamp((level - blending.x) / blending.y + 1.0, 0.0, 1.0);
    color = mix(color, picture, blend);
    lod = blend < 0.5 ? lod : pictureLod;
    patchIndex = blend < 0.5 ? patchIndex : -1.0;
#else
    color = picture;
    lod = pictureLod;
#endif
#endif

#if UMBRELLA_SCALED
    vec4 scale = record_fetch(record + 9);
    vec4 bias = record_fetch(record + 10);
    float alpha = clamp(color.a * scale.a + bias.a, 0.0, 1.0);
    color = vec4((color.rgb / max(color.a, 1e-6) * scale.rgb + bias.rgb) * alpha, alpha);  // 1e-6 guards what is clear
#endif
#if UMBRELLA_OUTSIDE
    // The border fades over one pixel within the texture.
    vec2 low = middle + vec2(rowX.w, rowY.w);
    vec2 fromBorder = min(low, sizes.xy - low);
    vec2 pixel = vec2(length(vec2(dx.x, dy.x)), length(vec2(dx.y, dy.y)));
    vec2 ramp = clamp(fromBorder / max(pixel, vec2(1e-30)), vec2(0.0), vec2(1.0));  // 1e-30 guards a constant st
    color *= (wrap.x == WRAP_BLACK ? ramp.x : 1.0) * (wrap.y == WRAP_BLACK ? ramp.y : 1.0);
#endif
#if UMBRELLA_PERSPECTIVE
    color = w > 0.0 ? color : vec4(0.0);
#endif
    return color;
}

// number: which umbrella texture of the material; st and its derivatives per pixel as the surface gives them.
// Returns linear, premultiplied rgba after scale and bias; lod: mip level of the image on top (negative when magnified);
// patchIndex: the umbrella on top, -1 for the background and for prefiltered levels.
vec4 umbrella_sample(int number, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    int record = umbrellaRecord[number].x;
#if UMBRELLA_FLATS
    if (number < UMBRELLA_FLATS)             // known when compiled
        return umbrella_lookup(true, number, record, st, dstdx, dstdy, lod, patchIndex);
#endif
    return umbrella_lookup(false, record, record, st, dstdx, dstdy, lod, patchIndex);
}

// As a patch of another texture: record is its place in the record texture; transparent outside of its [0, 1]^2.
vec4 umbrella_nested(int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    float patchIndex;
    return umbrella_lookup(false, record, record, st, dstdx, dstdy, lod, patchIndex);
}
