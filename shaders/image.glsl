// An image looked up at any mip level or footprint: the one place that chooses levels and filters, for kinds that find out
// where to look. Requires texture_data.glsl, common_footprint.glsl, common_wrap.glsl.
// Provides Image, image_open, image_at_level, image_sample.
//
// Defines: IMAGE_SRGB, IMAGE_HALF pages that hold images; IMAGE_LEVELS 1 where each is seen at one mip level only, else 2;
// IMAGE_PROBES 1 for anisotropic filtering; IMAGE_WRAPS 0 where all clamp.
//
// Record, written by fexel/textures/image_view.py:
//   0  width and height of level 0; codes = finest + 16 coarsest level + 256 page class + 1024 wrap mode along s + 4096 along t;
//      how many levels finer than by its size it is read
//   1  per level from the finest on: page coordinates of its lower left corner, and of that of the next coarser one
//
// Nothing here is skipped by branching, and loops leave behind only what a repetition of their last round does not change
// (see zipmap_tree.glsl).
#include "texture_data.glsl"
#include "common_footprint.glsl"
#include "common_wrap.glsl"

struct Image {
    int record;
    vec2 size;       // texels of level 0
    int codes;
    float bias;      // subtracted from the level that follows from the footprint
};

Image image_open(int record)
{
    vec4 head = record_fetch(record);
    return Image(record, head.xy, int(head.z), head.w);
}

// One bilinear fetch of a level; beyond the border of the image it stops at the texel past it, which holds what the wrap
// mode continues the image with. corner: page coordinates of uv (0, 0); size: texels of the level.
vec4 image_texel(vec2 uv, vec2 corner, vec2 size, int pageClass)
{
#if IMAGE_SRGB && IMAGE_HALF
    vec2 halfTexel = pageClass == PAGE_HALF ? pageHalfTexel[PAGE_HALF].xy : pageHalfTexel[PAGE_SRGB].xy;
#elif IMAGE_HALF
    vec2 halfTexel = pageHalfTexel[PAGE_HALF].xy;
#else
    vec2 halfTexel = pageHalfTexel[PAGE_SRGB].xy;
#endif
    vec2 halves = clamp(2.0 * uv * size, vec2(-1.0), 2.0 * size + 1.0);
    vec2 page = corner + vec2(halves.x, -halves.y) * halfTexel;
#if IMAGE_SRGB && IMAGE_HALF
    vec4 srgb = textureLod(pagesSrgb, page, 0.0);
    vec4 precise = textureLod(pagesHalf, page, 0.0);
    return pageClass == PAGE_HALF ? precise : srgb;
#elif IMAGE_HALF
    return textureLod(pagesHalf, page, 0.0);
#else
    return textureLod(pagesSrgb, page, 0.0);
#endif
}

vec2 image_level_size(Image image, int level)
{
    return vec2(max(ivec2(image.size) >> level, ivec2(1)));
}

// Trilinear at a real-valued mip level, within those that are there; linear, premultiplied.
vec4 image_at_level(Image image, vec2 uv, float level)
{
    int finest = image.codes & 15;
    int coarsest = (image.codes >> 4) & 15;
    int pageClass = (image.codes >> 8) & 3;
#if IMAGE_WRAPS
    uv = vec2(wrap_coordinate(uv.x, (image.codes >> 10) & 3), wrap_coordinate(uv.y, (image.codes >> 12) & 3));
#endif
#if IMAGE_LEVELS > 1
    float used = clamp(level, float(finest), float(coarsest));
    int fine = int(used);
    int coarse = min(fine + 1, coarsest);
    vec4 corners = record_fetch(image.record + 1 + fine - finest);
    return mix(image_texel(uv, corners.xy, image_level_size(image, fine), pageClass),
               image_texel(uv, corners.zw, image_level_size(image, coarse), pageClass), used - float(fine));
#else
    return image_texel(uv, record_fetch(image.record + 1).xy, image_level_size(image, finest), pageClass);
#endif
}

// uv: in [0, 1]^2 of the image, t up, wrapped here; dx, dy: its derivatives per pixel; lod: the mip level that was meant,
// negative when magnified. Linear, premultiplied.
vec4 image_sample(int record, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    Image image = image_open(record);
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
    return sum;
#else
    lod = isotropic_level(dx * image.size, dy * image.size) - image.bias;
    return image_at_level(image, uv, lod);
#endif
}
