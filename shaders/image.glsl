// An image looked up at any mip level or footprint: the one place that chooses levels and filters, for kinds that find
// out where to look. Requires texture_data.glsl.
// Provides Image, image_open, image_flat, image_at_level, image_filter, image_sample.
//
// Defines, without which there is nothing: IMAGE_SRGB, IMAGE_HALF pages that hold images; IMAGE_LEVELS 1 where each is
// seen at one mip level only, else 2; IMAGE_PROBES 1 for anisotropic probes; IMAGE_WRAPS 0 where all clamp; IMAGE_ENDS,
// IMAGE_MIRROR 1 where any image ends along an axis, or is mirrored; IMAGE_GAUSS 1 where fipmaps show Gaussians, not
// boxes; IMAGE_FILTER_<TOKEN> 1 for every filter that there is among the images; see also the filters' own files.
//
// Record, written by fexel/textures/image_view.py:
//   0  width and height of level 0; codes = finest + 16 coarsest level + 256 page class + 1024 wrap mode along s
//      + 4096 along t + 16384 filter; how many levels finer than by its size it is read
//   1  per level from the finest on: page coordinates of its lower left corner, and of that of the next coarser one
// and where its filter uses chains, the table of filter_chains.glsl.
//
// Nothing here is skipped by branching, and loops leave behind only what a repetition of their last round does not
// change (see zipmap_tree.glsl).
#include "texture_data.glsl"
#include "common_footprint.glsl"
#include "common_wrap.glsl"
#include "lookup_counts.glsl"

// As fexel/filters/__init__.py numbers them.
#define IMAGE_MIPMAP 0
#define IMAGE_ANISOTROPIC 1
#define IMAGE_RIPMAP 2
#define IMAGE_FIPMAP 3
#define IMAGE_EWA 4
#define IMAGE_AUTO 5

#if defined(IMAGE_LEVELS)
#define IMAGE_CHAINS (IMAGE_FILTER_RIPMAP || IMAGE_FILTER_FIPMAP || IMAGE_FILTER_AUTO)

struct Image {
    int record;
    vec2 size;       // texels of level 0
    int codes;
    float bias;      // subtracted from the level that follows from the footprint
    int filterCode;
    vec4 table;      // filter_chains.glsl
};

Image image_open(int record)
{
    vec4 head = record_fetch(record);
    int codes = int(head.z);
    vec4 table = vec4(0.0);
#if IMAGE_CHAINS
    table = record_fetch(record + 2 + ((codes >> 4) & 15) - (codes & 15));
    table.x += float(record);
#endif
    return Image(record, head.xy, codes, head.w, codes >> 14, table);
}

// The same of constants (FilterView.constants of fexel/filters/view.py): nothing is fetched.
Image image_flat(vec4 head, vec4 table)
{
    int codes = int(head.z);
    return Image(int(table.x) - 3 - ((codes >> 4) & 15) + (codes & 15), head.xy, codes, head.w, codes >> 14, table);
}

// Page coordinates of one image.
vec2 image_half_texel(Image image)
{
#if IMAGE_SRGB && IMAGE_HALF
    return ((image.codes >> 8) & 3) == PAGE_HALF ? pageHalfTexel[PAGE_HALF].xy : pageHalfTexel[PAGE_SRGB].xy;
#elif IMAGE_HALF
    return pageHalfTexel[PAGE_HALF].xy;
#else
    return pageHalfTexel[PAGE_SRGB].xy;
#endif
}

// One bilinear fetch.
vec4 image_page(Image image, vec2 page)
{
#if IMAGE_SRGB && IMAGE_HALF
    vec4 srgb = textureLod(pagesSrgb, page, 0.0);
    vec4 precise = textureLod(pagesHalf, page, 0.0);
    return ((image.codes >> 8) & 3) == PAGE_HALF ? precise : srgb;
#elif IMAGE_HALF
    return textureLod(pagesHalf, page, 0.0);
#else
    return textureLod(pagesSrgb, page, 0.0);
#endif
}

// One bilinear fetch of a level; beyond the border of the image it stops at the texel past it, which holds what the
// wrap mode continues the image with. corner: page coordinates of uv (0, 0); size: texels of the level.
vec4 image_texel(Image image, vec2 uv, vec2 corner, vec2 size)
{
    vec2 halves = clamp(2.0 * uv * size, vec2(-1.0), 2.0 * size + 1.0);
    return image_page(image, corner + vec2(halves.x, -halves.y) * image_half_texel(image));
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
#if IMAGE_WRAPS
    uv = vec2(wrap_coordinate(uv.x, (image.codes >> 10) & 3), wrap_coordinate(uv.y, (image.codes >> 12) & 3));
#endif
#if IMAGE_LEVELS > 1
    float used = clamp(level, float(finest), float(coarsest));
    int fine = int(used);
    int coarse = min(fine + 1, coarsest);
    vec4 corners = record_fetch(image.record + 1 + fine - finest);
    return mix(image_texel(image, uv, corners.xy, image_level_size(image, fine)),
               image_texel(image, uv, corners.zw, image_level_size(image, coarse)), used - float(fine));
#else
    return image_texel(image, uv, record_fetch(image.record + 1).xy, image_level_size(image, finest));
#endif
}

#endif

#include "filter_mipmap.glsl"
#include "filter_anisotropic.glsl"
#include "filter_chains.glsl"
#include "filter_tiles.glsl"
#include "filter_ripmap.glsl"
#include "filter_fipmap.glsl"
#include "filter_fipmap_gauss.glsl"
#include "filter_ewa.glsl"
#include "filter_auto.glsl"

#if defined(IMAGE_LEVELS)

// uv: in [0, 1]^2 of the image, t up, wrapped here; dx, dy: its derivatives per pixel; lod: the mip level that was
// meant, negative when magnified. Linear, premultiplied.
vec4 image_filter(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
#if IMAGE_FILTER_MIPMAP + IMAGE_FILTER_ANISOTROPIC + IMAGE_FILTER_RIPMAP + IMAGE_FILTER_FIPMAP + IMAGE_FILTER_EWA \
    + IMAGE_FILTER_AUTO == 1
#define IMAGE_IS(code) true
#else
#define IMAGE_IS(code) image.filterCode == code
#endif
    vec4 color = vec4(0.0);
    lod = 0.0;
#if IMAGE_FILTER_MIPMAP
    if (IMAGE_IS(IMAGE_MIPMAP))
        color = filter_mipmap(image, uv, dx, dy, maxProbes, lod);
#endif
#if IMAGE_FILTER_ANISOTROPIC
    if (IMAGE_IS(IMAGE_ANISOTROPIC))
        color = filter_anisotropic(image, uv, dx, dy, maxProbes, lod);
#endif
#if IMAGE_FILTER_RIPMAP
    if (IMAGE_IS(IMAGE_RIPMAP))
        color = filter_ripmap(image, uv, dx, dy, maxProbes, lod);
#endif
#if IMAGE_FILTER_FIPMAP
    if (IMAGE_IS(IMAGE_FIPMAP))
        color = filter_fipmap(image, uv, dx, dy, maxProbes, lod);
#endif
#if IMAGE_FILTER_EWA
    if (IMAGE_IS(IMAGE_EWA))
        color = filter_ewa(image, uv, dx, dy, maxProbes, lod);
#endif
#if IMAGE_FILTER_AUTO
    if (IMAGE_IS(IMAGE_AUTO))
        color = filter_auto(image, uv, dx, dy, maxProbes, lod);
#endif
    return color;
}

vec4 image_sample(int record, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    return image_filter(image_open(record), uv, dx, dy, maxProbes, lod);
}
#endif
