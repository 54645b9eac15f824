// Zipmaps of which nothing but the root is seen, with a filter that reads prefiltered images: one lookup of image.glsl,
// without index or records of layers. Included by zipmap.glsl. Provides zipmap_root_sample.
//
// Defines: ZIPMAP_ROOTS how many; ZIPMAP_FLAT + ZIPMAP_ROOTS_FLAT first of their varyings, five for each;
// ZIPMAP_PROJECTIVE 1 where the map from local st to any is.
//
// Varyings of a root: rows u, v, w from (s, t, 1) to [0, 1]^2 of the image; then head and table of image_flat.
#if ZIPMAP_ROOTS

#define ZIPMAP_ROOT_CONSTANT(root, i) textureFlat[ZIPMAP_FLAT + ZIPMAP_ROOTS_FLAT + 5 * (root) + (i)]

vec4 zipmap_root_sample(int root, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    vec4 u = ZIPMAP_ROOT_CONSTANT(root, 0);
    vec4 v = ZIPMAP_ROOT_CONSTANT(root, 1);
    vec2 uv = vec2(u.x * st.x + u.y * st.y + u.z, v.x * st.x + v.y * st.y + v.z);
    vec2 dx = vec2(dot(u.xy, dstdx), dot(v.xy, dstdx));
    vec2 dy = vec2(dot(u.xy, dstdy), dot(v.xy, dstdy));
    bool isFront = true;
#if ZIPMAP_PROJECTIVE
    // Exact Jacobian of the projective map: d(uv / w) = (d(uv) - uv / w d(w)) / w.
    vec4 w = ZIPMAP_ROOT_CONSTANT(root, 2);
    float depth = w.x * st.x + w.y * st.y + w.z;
    isFront = depth > 0.0;
    float inverse = isFront ? 1.0 / depth : 0.0;
    uv *= inverse;
    dx = (dx - uv * dot(w.xy, dstdx)) * inverse;
    dy = (dy - uv * dot(w.xy, dstdy)) * inverse;
#endif
    patchIndex = 0.0;
    Image image = image_flat(ZIPMAP_ROOT_CONSTANT(root, 3), ZIPMAP_ROOT_CONSTANT(root, 4));
    vec4 color = image_filter(image, uv, dx, dy, zipmapImageProbes, lod);
    return isFront ? color : vec4(0.0);
}
#endif
