// Umbrella textures (Just-in-time texture synthesis 2012): a few patches, many times placed and varied, composed per pixel.
// Requires texture_data.glsl, common_footprint.glsl, common_wrap.glsl, image.glsl. Provides umbrella_sample, umbrella_nested.
//
// Defines: UMBRELLA_SLOTS textures of the material; UMBRELLA_DRAWN 1 where the view sees umbrellas, UMBRELLA_MERGED most
// coarser arrangements it sees besides, UMBRELLA_PICTURE 1 where it sees a prefiltered picture; UMBRELLA_PROBES 1 for
// anisotropic filtering, UMBRELLA_MIXED 1 where not all may take as many probes; UMBRELLA_FILTERED 1 where images of bases
// are looked up by a filter of their own; and what the umbrellas of any slot use: UMBRELLA_SHADOWS, UMBRELLA_COLORS vertex colours,
// UMBRELLA_ALPHA images with alpha, UMBRELLA_COVERAGES below 1, UMBRELLA_VECTORS, UMBRELLA_SCALED a scale or bias,
// UMBRELLA_OUTSIDE a wrap mode black, UMBRELLA_PERSPECTIVE a projective map to st; see also umbrella_search.glsl.
//
// Record, written by fexel/textures/umbrella_binding.py:
//   0  position.x * w from (s, t, 1) in cells of the arrangement, less base.x * w; base.x
//   1  position.y ...; base.y
//   2  cells along s, t; cells of the full grid per cell, along s, t
//   3  page texels of the first texel: of the float page, of the half page
//   4  bins and slices of the tables; colour blend; codes = wrap mode along s + 4 * along t + 16 * log2 of a row of the float
//      page's texels + 512 * log2 of one of the half page's + 16384 where texels are vectors, twice where one of their axes
//      runs backward + 65536 where images of bases are looked up by a filter of their own
//   5  shadow offset in cells; strength; record of the first base image
//   6  records of the background and of the picture; texels of the record of an image; texels of an entry
//   7  w from (s, t, 1); most probes
//   8  coarser arrangements that follow, each with a record; level of this one; level of the picture; 1 if there is one
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
#include "lookup_counts.glsl"
#include "image.glsl"
#include "umbrella_search.glsl"
#include "umbrella_compose.glsl"

uniform ivec4 umbrellaRecord[UMBRELLA_SLOTS];
uniform float umbrellaMaxProbes;
#if UMBRELLA_MIXED
#define UMBRELLA_MOST(record) record_fetch(record + 7).w
#else
#define UMBRELLA_MOST(record) umbrellaMaxProbes
#endif

#define UMBRELLA_RECORD 11                   // texels

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

// Where st lies in cells, relative to the base, with its derivatives per pixel.
struct UmbrellaPosition {
    vec2 relative;
    vec2 base;
    vec2 dx;
    vec2 dy;
    vec2 cells;
    vec2 perCell;            // cells of the full grid, also of a coarser arrangement
    float w;
};

UmbrellaPosition umbrella_position(bool isFlat, int place, int record, vec2 st, vec2 dstdx, vec2 dstdy)
{
    vec4 rowX = umbrella_constant(isFlat, place, 0);
    vec4 rowY = umbrella_constant(isFlat, place, 1);
    vec4 sizes = umbrella_constant(isFlat, place, 2);
    vec2 relative = vec2(dot(rowX.xy, st) + rowX.z, dot(rowY.xy, st) + rowY.z);
    vec2 dx = vec2(dot(rowX.xy, dstdx), dot(rowY.xy, dstdx));
    vec2 dy = vec2(dot(rowX.xy, dstdy), dot(rowY.xy, dstdy));
    float w = 1.0;
#if UMBRELLA_PERSPECTIVE
    // Exact Jacobian of the projective map: d(xy / w) = (d(xy) - xy / w d(w)) / w.
    vec4 rowW = record_fetch(record + 7);
    w = dot(rowW.xy, st) + rowW.z;
    float inverse = w > 0.0 ? 1.0 / w : 0.0;
    relative *= inverse;
    dx = (dx - relative * dot(rowW.xy, dstdx)) * inverse;
    dy = (dy - relative * dot(rowW.xy, dstdy)) * inverse;
#endif
    return UmbrellaPosition(relative, vec2(rowX.w, rowY.w), dx, dy, sizes.xy, sizes.zw, w);
}

#if UMBRELLA_DRAWN
// One arrangement; several probes along a long footprint, each of which covers its share of it.
vec4 umbrella_arrangement(bool isFlat, int place, int record, UmbrellaPosition at, out float lod, out float patchIndex)
{
    UmbrellaLook look = umbrella_look(at.cells, umbrella_constant(isFlat, place, 3), umbrella_constant(isFlat, place, 4),
                                      umbrella_constant(isFlat, place, 5), umbrella_constant(isFlat, place, 6));
#if UMBRELLA_PROBES
    vec2 gridX = at.dx * at.perCell;
    vec2 gridY = at.dy * at.perCell;
    Footprint axes = make_footprint(gridX, gridY);
    float weight = 1.0 / footprint_probes(axes, UMBRELLA_MOST(record));
    vec2 major = axes.majorDirection / at.perCell;
    vec2 shorten = axes.majorDirection * ((1.0 - weight) / (axes.majorAxis * axes.majorAxis));
    vec2 dx = at.dx - major * dot(shorten, gridX);
    vec2 dy = at.dy - major * dot(shorten, gridY);
    vec4 color = vec4(0.0);
    lod = 0.0;
    patchIndex = -1.0;
    float along = 0.5 * weight - 0.5;
    do {
        float probeLod;
        float probePatch;
        vec4 probe = umbrella_compose(look, at.relative + along * major, at.base, dx, dy, probeLod, probePatch);
        bool running = along < 0.5;
        color += running ? weight * probe : vec4(0.0);
        // The probe in the middle, or the one just before it, tells what is seen.
        bool tells = running && along <= 0.0;
        lod = tells ? probeLod : lod;
        patchIndex = tells ? probePatch : patchIndex;
        along += weight;
    } while (along < 0.5);
    return color;
#else
    return umbrella_compose(look, at.relative, at.base, at.dx, at.dy, lod, patchIndex);
#endif
}
#endif

#if UMBRELLA_MERGED
// Two levels of detail that bracket the one that is meant, one after the other.
vec4 umbrella_levels(int record, vec2 st, vec2 dstdx, vec2 dstdy, float chosen, float blend, bool both, out float lod,
                     out float patchIndex)
{
    vec4 color = vec4(0.0);
    lod = 0.0;
    patchIndex = -1.0;
    float number = chosen;
    float share = 1.0 - blend;
    bool running = true;
    do {
        int place = record + UMBRELLA_RECORD * int(number);
        UmbrellaPosition at = umbrella_position(false, place, place, st, dstdx, dstdy);
        float levelLod;
        float levelPatch;
        vec4 level = umbrella_arrangement(false, place, place, at, levelLod, levelPatch);
        color += running ? share * level : vec4(0.0);
        bool tells = running && share >= 0.5;
        lod = tells ? levelLod : lod;
        patchIndex = tells && number == 0.0 && record_fetch(record + 8).y == 0.0 ? levelPatch : patchIndex;
        running = running && both && number == chosen;
        number = chosen + 1.0;
        share = blend;
    } while (running);
    return color;
}
#endif

vec4 umbrella_lookup(bool isFlat, int place, int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    UmbrellaPosition at = umbrella_position(isFlat, place, record, st, dstdx, dstdy);
    vec4 color = vec4(0.0);
    lod = 0.0;
    patchIndex = -1.0;
    float blend = 0.0;                       // of the picture
#if UMBRELLA_MERGED || UMBRELLA_PICTURE
#if UMBRELLA_PROBES
    float level = footprint_level(make_footprint(at.dx * at.perCell, at.dy * at.perCell), UMBRELLA_MOST(record));
#else
    float level = isotropic_level(at.dx * at.perCell, at.dy * at.perCell);
#endif
    level -= log2(UMBRELLA_FIRST_LEVEL);
    vec4 levels = record_fetch(record + 8);
    float from = levels.y;
    float to = levels.z;
    bool both = false;
#if UMBRELLA_MERGED
    float chosen = 0.0;
    float next = levels.z;
    for (int i = UMBRELLA_MERGED; i > 0; --i) {
        float further = record_fetch(record + UMBRELLA_RECORD * min(i, int(levels.x)) + 8).y;
        bool isThere = float(i) <= levels.x;
        bool isReached = isThere && further <= level && chosen == 0.0;
        chosen = isReached ? float(i) : chosen;
        from = isReached ? further : from;
        next = isThere && further > level ? further : next;
    }
    to = next;
    both = chosen < levels.x;
#endif
    blend = to > from && (both || levels.w > 0.0) ? clamp((level - from) / (to - from), 0.0, 1.0) : 0.0;
#endif
#if UMBRELLA_MERGED
    color = umbrella_levels(record, st, dstdx, dstdy, chosen, blend, both && blend > 0.0, lod, patchIndex);
    blend = both ? 0.0 : blend;
#elif UMBRELLA_DRAWN
    color = umbrella_arrangement(isFlat, place, record, at, lod, patchIndex);
#endif

    UmbrellaLook look = umbrella_look(at.cells, umbrella_constant(isFlat, place, 3), umbrella_constant(isFlat, place, 4),
                                      umbrella_constant(isFlat, place, 5), umbrella_constant(isFlat, place, 6));
#if UMBRELLA_PICTURE
    vec3 s = wrap_locate(at.relative.x, at.base.x, at.cells.x, look.wrap.x);
    vec3 t = wrap_locate(at.relative.y, at.base.y, at.cells.y, look.wrap.y);
    vec2 turned = vec2(s.z < 0.0 ? -1.0 : 1.0, t.z < 0.0 ? -1.0 : 1.0);
    vec2 uv = vec2(s.x + s.y, t.x + t.y) / at.cells;
    float pictureLod;
    vec4 picture = image_sample(look.picture, uv, turned * at.dx / at.cells, turned * at.dy / at.cells, UMBRELLA_MOST(record),
                                pictureLod);
#if UMBRELLA_DRAWN
    bool isThere = levels.w > 0.0;
    blend = isThere ? blend : 0.0;
#if UMBRELLA_MERGED
    color = (both || !isThere) ? color : color + blend * picture;
#else
    color = mix(color, picture, blend);
#endif
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
    vec2 position = at.relative + at.base;
    vec2 fromBorder = min(position, at.cells - position);
    vec2 pixel = vec2(length(vec2(at.dx.x, at.dy.x)), length(vec2(at.dx.y, at.dy.y)));
    vec2 ramp = clamp(fromBorder / max(pixel, vec2(1e-30)), vec2(0.0), vec2(1.0));  // 1e-30 guards a constant st
    color *= (look.wrap.x == WRAP_BLACK ? ramp.x : 1.0) * (look.wrap.y == WRAP_BLACK ? ramp.y : 1.0);
#endif
    return at.w > 0.0 ? color : vec4(0.0);
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
