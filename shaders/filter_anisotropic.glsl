// Isotropic probes along the major axis, as hardware has them. Included by image.glsl. Provides filter_anisotropic.
//
// Defines: IMAGE_PROBES 0 where one probe is enough for all that is seen.
#if defined(IMAGE_LEVELS)
vec4 filter_anisotropic(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
#if IMAGE_PROBES
    Footprint footprint = make_footprint(dx * image.size, dy * image.size);
    float weight = 1.0 / footprint_probes(footprint, maxProbes);
    vec2 major = footprint.majorDirection / image.size;
    lod = footprint_level(footprint, maxProbes) - image.bias;
    float along = 0.5 * weight - 0.5;
    vec4 sum = vec4(0.0);
    do {
        sum += along < 0.5 ? weight * image_at_level(image, uv + along * major, lod) : vec4(0.0);
        along += weight;
    } while (along < 0.5);
    LOOKUP_COUNT((IMAGE_LEVELS > 1 ? 8.0 : 4.0) / weight);
    return sum;
#else
    return filter_mipmap(image, uv, dx, dy, maxProbes, lod);
#endif
}
#endif
