// Zipmaps of a few layers: every one is looked at everywhere, without index, records or loops.
// Included by zipmap.glsl. Provides zipmap_list_sample.
//
// Only for layers whose maps are affine, whose texels have the shape of the root's, so that their mip levels differ by a
// constant, and of which two levels at most are seen. They are unrolled, and what is known of each is compiled in. What
// differs from view to view comes as flat varyings (texture_vertex.glsl): as uniforms it was measured to cost llvmpipe
// about as much as the lookups themselves.
//
// Defines: ZIPMAP_LAYERS most layers of a slot; ZIPMAP_FLAT first of the varyings, four per slot and layer;
// ZIPMAP_CODES<slot>: layers of the slot + 16 sum_i 4^i codes_i, i counted front to back, codes_i = 1 where layer i is seen at two mip levels, + 2 where
// it is in the half-float pages.
//
// Varyings of a layer: x of texels / size from (s, t, 1), opacity; y, mip level of the finest image at root level 0;
// then for the finest and the next level: scale.xy, offset.xy from there to page coordinates.
#if ZIPMAP_LAYERS

#define ZIPMAP_CONSTANT(layer, i) textureFlat[ZIPMAP_FLAT + 4 * (layer) + (i)]

uniform vec4 zipmapNumbers[ZIPMAP_SLOTS * ZIPMAP_LAYERS];   // index of the layer, finest level
uniform vec4 zipmapRoot[ZIPMAP_SLOTS];                      // from local st to texels of the root: d(x) by s, t, d(y)

struct ZipmapBlend {
    vec4 color;
    float clear;
    float lod;
    float patchIndex;
};

// place: scale.xy, offset.xy to page coordinates. The root may stop beyond its edge, at the border texel.
vec4 zipmap_list_texel(vec2 uv, vec4 place, bool isHalf, bool isRoot)
{
    vec2 page = uv * place.xy + place.zw;
#if ZIPMAP_OUTSIDE
    vec2 margin = pageHalfTexel[isHalf ? PAGE_HALF : PAGE_SRGB].xy;
    if (isRoot)
        page = clamp(page, place.zw - margin, place.xy + place.zw + margin);
#endif
#if ZIPMAP_SRGB && ZIPMAP_HALF
    if (isHalf)
        return textureLod(pagesHalf, page, 0.0);
    return textureLod(pagesSrgb, page, 0.0);
#elif ZIPMAP_HALF
    return textureLod(pagesHalf, page, 0.0);
#else
    return textureLod(pagesSrgb, page, 0.0);
#endif
}

// All int and bool arguments are known when compiled, so that no branch and no index is left.
void zipmap_list_layer(int slot, int layer, int codes, bool isRoot, vec2 st, float rootLevel, inout ZipmapBlend blend)
{
    vec4 x = ZIPMAP_CONSTANT(layer, 0);
    vec4 y = ZIPMAP_CONSTANT(layer, 1);
    bool isHalf = ZIPMAP_SRGB == 0 || (codes & 2) != 0;
    vec2 uv = vec2(x.x * st.x + x.y * st.y + x.z, y.x * st.x + y.y * st.y + y.z);
    // A pixel beyond a patch may meet anything in the page, since only what is seen of a level is there.
    bool covers = true;
    if (!isRoot)
        covers = min(uv.x, uv.y) >= 0.0 && max(uv.x, uv.y) <= 1.0;
#if ZIPMAP_OUTSIDE
    else
        uv = vec2(zipmap_wrap(uv.x, 1.0, zipmapWrap[slot].x), zipmap_wrap(uv.y, 1.0, zipmapWrap[slot].y));
#else
    else
        uv = clamp(uv, vec2(0.0), vec2(1.0));  // samples of a pixel that is covered in part may stray
#endif
    float level = rootLevel + y.w;
    vec4 sampled = zipmap_list_texel(uv, ZIPMAP_CONSTANT(layer, 2), isHalf, isRoot);
    if ((codes & 1) != 0)
        sampled = mix(sampled, zipmap_list_texel(uv, ZIPMAP_CONSTANT(layer, 3), isHalf, isRoot), clamp(level, 0.0, 1.0));
    LOOKUP_COUNT(covers ? (codes & 1) != 0 ? 8.0 : 4.0 : 0.0);
    bool first = blend.clear == 1.0 && covers && sampled.a > 0.0;
    vec4 numbers = zipmapNumbers[layer];
    blend.lod = first ? numbers.y + ((codes & 1) != 0 ? level : 0.0) : blend.lod;
    blend.patchIndex = first ? numbers.x : blend.patchIndex;
    if (isHalf)
        sampled = covers ? sampled : vec4(0.0);
    blend.color += (covers ? blend.clear * x.w : 0.0) * sampled;
    blend.clear = 1.0 - blend.color.a;
}

vec4 zipmap_list_sample(int slot, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    int codes = zipmap_codes(slot);
    int count = codes & 15;
    int base = slot * ZIPMAP_LAYERS;
    vec4 root = zipmapRoot[slot];
    float rootLevel = isotropic_level(vec2(dot(root.xy, dstdx), dot(root.zw, dstdx)),
                                      vec2(dot(root.xy, dstdy), dot(root.zw, dstdy)));
    ZipmapBlend blend = ZipmapBlend(vec4(0.0), 1.0, rootLevel, 0.0);
#define ZIPMAP_LAYER(i)                                                                                                   \
    if (i < count)                                                                                                        \
        zipmap_list_layer(slot, base + i, (codes >> (4 + 2 * i)) & 3, i == count - 1, st, rootLevel, blend);
    ZIPMAP_LAYER(0)
    ZIPMAP_LAYER(1)
    ZIPMAP_LAYER(2)
    ZIPMAP_LAYER(3)
    ZIPMAP_LAYER(4)
    ZIPMAP_LAYER(5)
    ZIPMAP_LAYER(6)
    lod = blend.lod;
    patchIndex = blend.patchIndex;
    return blend.color;
}
#endif
