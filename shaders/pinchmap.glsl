// Pinchmap lookup (Tarini and Cignoni 2005): a signal texture looked up where its pinchmap says, so that it has sharp edges.
// Requires texture_data.glsl, common_footprint.glsl, image.glsl, pinchmap_warp.glsl. Provides pinchmap_sample, pinchmap_nested.
//
// Two ways: constants in varyings, one bilinear access to each texture (pinchmap_fast.glsl); or records, for deep zooms,
// grazing views and patches of other textures (pinchmap_record.glsl).
//
// Defines: PINCHMAP_SLOTS textures of the material; PINCHMAP_CODES<slot> 0 for the record, else what pinchmap_fast.glsl says;
// PINCHMAP_FAST, PINCHMAP_RECORDS whether any goes either way; PINCHMAP_SNORM, PINCHMAP_FLOAT pages of pinchmaps;
// PINCHMAP_SRGB, PINCHMAP_HALF pages of signals.
//
// Positions are in texels of the pinchmap, t up: texel j of the pinchmap lies at position j.
#include "texture_data.glsl"
#include "common_footprint.glsl"
#include "lookup_counts.glsl"
#include "image.glsl"
#include "pinchmap_warp.glsl"

uniform ivec4 pinchmapRecord[PINCHMAP_SLOTS];   // place in the record texture, finest mip level

#define PINCHMAP_CLAMP 0
#define PINCHMAP_REPEAT 1
#define PINCHMAP_MIRROR 2
#define PINCHMAP_BLACK 3

// A wrapped position along an axis.
float pinchmap_wrap(float position, float size, int mode)
{
    if (mode == PINCHMAP_REPEAT)
        return position - size * floor(position / size);
    if (mode == PINCHMAP_MIRROR)
        return abs(position - 2.0 * size * floor(0.5 * position / size + 0.5));
    return clamp(position, 0.0, size);
}

// One bilinear access to the signal. Linear, premultiplied.
vec4 pinchmap_signal(vec2 page, bool isHalf)
{
#if PINCHMAP_SRGB && PINCHMAP_HALF
    if (isHalf)
        return textureLod(pagesHalf, page, 0.0);
    return textureLod(pagesSrgb, page, 0.0);
#elif PINCHMAP_HALF
    return textureLod(pagesHalf, page, 0.0);
#else
    return textureLod(pagesSrgb, page, 0.0);
#endif
}

// The solid line over a colour; lineColor premultiplied.
vec4 pinchmap_over(vec4 color, vec4 lineColor, float coverage)
{
    return coverage * lineColor + (1.0 - coverage * lineColor.a) * color;
}

#include "pinchmap_fast.glsl"
#include "pinchmap_record.glsl"

// slot: which pinchmap of the material; st and its derivatives per pixel as the surface gives them; not inside a branch.
// Returns linear, premultiplied rgba; lod: mip level of the signal (negative when magnified), patchIndex: 0.
vec4 pinchmap_sample(int slot, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    patchIndex = 0.0;
#if PINCHMAP_FAST && PINCHMAP_RECORDS
    if (pinchmap_codes(slot) != 0)           // known when compiled
        return pinchmap_fast_sample(slot, st, dstdx, dstdy, lod);
    return pinchmap_record_sample(pinchmapRecord[slot].x, st, dstdx, dstdy, lod);
#elif PINCHMAP_FAST
    return pinchmap_fast_sample(slot, st, dstdx, dstdy, lod);
#else
    return pinchmap_record_sample(pinchmapRecord[slot].x, st, dstdx, dstdy, lod);
#endif
}

#if PINCHMAP_RECORDS
// As a patch of another texture: record is its place in the record texture; transparent outside of its [0, 1]^2.
vec4 pinchmap_nested(int record, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    return pinchmap_record_sample(record, st, dstdx, dstdy, lod);
}
#endif
