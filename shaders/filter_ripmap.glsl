// Ripmap (McReynolds 1998): chains along the axes of the texture alone. Twin of fexel/filters/ripmap.py. Included by
// image.glsl. Provides filter_ripmap.
#if defined(IMAGE_LEVELS) && IMAGE_FILTER_RIPMAP

const float RIPMAP_ACCESSES = 2.0;

vec4 filter_ripmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    bool alongX = rows.xx >= rows.yy;
    lod = chain_level(sqrt(max(alongX ? rows.yy : rows.xx, CHAIN_FLOOR)));
    float octaves = max(chain_octaves(chain_sides(rows, alongX), lod, RIPMAP_ACCESSES), 0.0);
    ChainExtent extent = chain_extent(image, rows, alongX, 0.0);
    ChainPlace cell = chain_place(image, uv, extent, octaves, lod);
    ChainBoxes boxes = chain_boxes(cell, extent, RIPMAP_ACCESSES);
    vec2 one = chain_box(boxes, 0.0);
    vec2 two = chain_box(boxes, 1.0);
    vec2 slant = vec2(1.0, boxes.lean);
    LOOKUP_COUNT(4.0 * RIPMAP_ACCESSES);
    return (one.y * chain_access(image, cell, cell.at + slant * one.x) + two.y * chain_access(image, cell, cell.at + slant * two.x))
         / (one.y + two.y);
}
#endif
