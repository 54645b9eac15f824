// Where textures of all kinds keep their data: pages of texels, records, constants of the draw.
// Provides page samplers, page_texel, record_fetch, textureFlat.
//
// Defines: PAGES_SRGB, PAGES_HALF, PAGES_SNORM, PAGES_FLOAT which pages there are; TEXTURE_RECORDS 1 where any kind reads
// records; TEXTURE_FLAT, if any, how many constants come as flat varyings (texture_vertex.glsl), each kind's from <KIND>_FLAT on.
// Texels are linear and, but for data, premultiplied. A window in a page has a border of one texel.

// Page classes, as fexel/textures/page_format.py numbers them.
#define PAGE_SRGB 0
#define PAGE_HALF 1
#define PAGE_SNORM 2
#define PAGE_FLOAT 3

#if PAGES_SRGB
uniform sampler2D pagesSrgb;
#endif
#if PAGES_HALF
uniform sampler2D pagesHalf;
#endif
#if PAGES_SNORM
uniform sampler2D pagesSnorm;
#endif
#if PAGES_FLOAT
uniform sampler2D pagesFloat;
#endif
uniform vec4 pageHalfTexel[4];               // xy: half a texel in page coordinates, per page class

#if TEXTURE_RECORDS
#define RECORD_ROW_BITS 10

uniform sampler2D textureRecords;            // RGBA32F

vec4 record_fetch(int index)
{
    return texelFetch(textureRecords, ivec2(index & ((1 << RECORD_ROW_BITS) - 1), index >> RECORD_ROW_BITS), 0);
}
#endif

#ifdef TEXTURE_FLAT
flat in vec4 textureFlat[TEXTURE_FLAT];
#endif
