// Zipmap lookup (Eisemann and Magnor 2010, eq. 1): C = sum_i w_i C_i, w_i = alpha_i prod_{j>i} (1 - alpha_j), front to back.
// Requires texture_data.glsl, common_footprint.glsl, image.glsl. Provides zipmap_sample.
//
// Three ways to the layers of a place: a short list is unrolled (zipmap_list.glsl), a root that is seen alone and whose
// filter reads prefiltered images is one lookup of image.glsl (zipmap_root.glsl), all else goes by the index
// (zipmap_tree.glsl).
//
// Defines: ZIPMAP_SLOTS textures of the material; ZIPMAP_CODES<slot> 0 for the index, below 0 for a lone root, else what
// zipmap_list.glsl says; ZIPMAP_TREE, ZIPMAP_ROOTS, ZIPMAP_LAYERS whether any slot goes by the index, how many are lone
// roots, and the longest list; ZIPMAP_FILTERED 1 where layers within an index are looked up by image.glsl; ZIPMAP_OUTSIDE
// 1 where the root is seen outside of [0, 1]^2; ZIPMAP_SCALED 0 where no slot has a scale or bias; ZIPMAP_SRGB,
// ZIPMAP_HALF which pages there are;
// ZIPMAP_KIND<k>_SAMPLE the function that samples patches of another kind, where there are any of kind number k.
#include "texture_data.glsl"
#include "common_footprint.glsl"
#include "lookup_counts.glsl"
#include "image.glsl"

#define ZIPMAP_PATCH 0.0
#define ZIPMAP_CLAMP 1.0
#define ZIPMAP_REPEAT 2.0
#define ZIPMAP_MIRROR 3.0

uniform vec4 zipmapWrap[ZIPMAP_SLOTS];       // wrap mode of the root along s, t
uniform vec4 zipmapScale[ZIPMAP_SLOTS];
uniform vec4 zipmapBias[ZIPMAP_SLOTS];
uniform float zipmapImageProbes;             // most anisotropic ones that image.glsl may take

#ifndef ZIPMAP_CODES1
#define ZIPMAP_CODES1 0
#endif
#ifndef ZIPMAP_CODES2
#define ZIPMAP_CODES2 0
#endif
#ifndef ZIPMAP_CODES3
#define ZIPMAP_CODES3 0
#endif
#ifndef ZIPMAP_CODES4
#define ZIPMAP_CODES4 0
#endif
#ifndef ZIPMAP_CODES5
#define ZIPMAP_CODES5 0
#endif
#ifndef ZIPMAP_CODES6
#define ZIPMAP_CODES6 0
#endif
#ifndef ZIPMAP_CODES7
#define ZIPMAP_CODES7 0
#endif

int zipmap_codes(int slot)
{
    return slot == 0 ? ZIPMAP_CODES0 : slot == 1 ? ZIPMAP_CODES1 : slot == 2 ? ZIPMAP_CODES2 : slot == 3 ? ZIPMAP_CODES3
         : slot == 4 ? ZIPMAP_CODES4 : slot == 5 ? ZIPMAP_CODES5 : slot == 6 ? ZIPMAP_CODES6 : ZIPMAP_CODES7;
}

// A wrapped texel coordinate of the root; size in texels.
float zipmap_wrap(float x, float size, float mode)
{
    float period = x / size;
    float repeated = (period - floor(period)) * size;
    float mirrored = abs(period - 2.0 * floor(0.5 * period + 0.5)) * size;
    return mode == ZIPMAP_REPEAT ? repeated : mode == ZIPMAP_MIRROR ? mirrored : mode == ZIPMAP_CLAMP ? clamp(x, 0.0, size) : x;
}

#include "zipmap_tree.glsl"
#include "zipmap_list.glsl"
#include "zipmap_root.glsl"

// slot: which texture of the material; st and its derivatives per pixel as the surface gives them.
// Returns linear, premultiplied rgba after scale and bias; lod: mip level at which the nearest layer was seen (negative
// when magnified), patchIndex: that layer's number.
vec4 zipmap_sample(int slot, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    vec4 color;
    int codes = zipmap_codes(slot);          // known when compiled
#if ZIPMAP_TREE
    if (codes == 0)
        color = zipmap_tree_sample(slot, st, dstdx, dstdy, lod, patchIndex);
#endif
#if ZIPMAP_LAYERS
    if (codes > 0)
        color = zipmap_list_sample(slot, st, dstdx, dstdy, lod, patchIndex);
#endif
#if ZIPMAP_ROOTS
    if (codes < 0)
        color = zipmap_root_sample(-1 - codes, st, dstdx, dstdy, lod, patchIndex);
#endif
#if ZIPMAP_SCALED
    float alpha = color.a * zipmapScale[slot].a + zipmapBias[slot].a;
    float ratio = color.a > 0.0 ? alpha / color.a : 0.0;
    return vec4((color.rgb * zipmapScale[slot].rgb + color.a * zipmapBias[slot].rgb) * ratio, alpha);
#else
    return color;
#endif
}
