// Trilinear: one probe, at the level of the longer axis. Included by image.glsl. Provides filter_mipmap.
#if defined(IMAGE_LEVELS)
vec4 filter_mipmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    lod = isotropic_level(dx * image.size, dy * image.size) - image.bias;
    LOOKUP_COUNT(IMAGE_LEVELS > 1 ? 8 : 4);
    return image_at_level(image, uv, lod);
}
#endif
