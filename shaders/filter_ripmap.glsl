// Ripmap (McReynolds 1998): chains along the axes of the texture alone. Twin of fexel/filters/ripmap.py. Included by
// image.glsl. Provides filter_ripmap.
#if defined(IMAGE_LEVELS) && IMAGE_FILTER_RIPMAP

const float RIPMAP_ACCESSES = 2.0;

vec4 filter_ripmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    bool alongX = chain_along_x(rows);
    int level = chain_level(alongX ? rows.yy : rows.xx);
    int octaves = max(chain_octaves(chain_sides(rows, alongX), level, RIPMAP_ACCESSES), 0);
    ChainExtent extent = chain_plain(image, rows, alongX);
#if IMAGE_TILES
    Tile tile = tile_of(image, extent, chain_seen(extent.sides, RIPMAP_ACCESSES));
    level = max(level, tile.level);
#endif
    ChainCell cell = chain_cell(image, uv, extent, octaves, level);
    ChainBoxes boxes = chain_boxes(cell, extent, RIPMAP_ACCESSES);
#if IMAGE_TILES
    tile_spread(tile, extent, RIPMAP_ACCESSES, cell, boxes);
#endif
    vec2 one = chain_box(boxes, 0.0);
    vec2 two = chain_box(boxes, 1.0);
    lod = float(level);
    LOOKUP_COUNT(4.0 * RIPMAP_ACCESSES);
    // Places before accesses, for llvmpipe keeps in memory what it needs beyond one.
    vec2 onePage = chain_page(cell, cell.at + boxes.step * one.x);
    vec2 twoPage = chain_page(cell, cell.at + boxes.step * two.x);
    float share = two.y / (one.y + two.y);
    return mix(image_page(image, onePage), image_page(image, twoPage), share);
}
#endif
