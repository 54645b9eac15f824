// Footprints of more periods of a small repeating image than accesses can read one by one. Included by image.glsl after
// filter_chains.glsl. Provides Tile, tile_of, tile_spread. Twin of fexel/filters/tiles.py, which says why.
//
// Defines: IMAGE_TILES 1 where any image may be seen so; without it there is nothing.
#if defined(IMAGE_LEVELS) && IMAGE_CHAINS && IMAGE_TILES

const float TILE_ACCESS = 1.41421356;
const float TILE_SINGLE = 0.5;

struct Tile {
    float stride;     // periods of the long axis per box; 0 where boxes are those of the chain
    float drift;      // texels of level 0 along the moved axis per period, without whole periods of that axis
    int level;        // the finest one
};

// seen: texels of level 0 that a box is long of which a footprint is as long as accesses can read; 0: no boxes.
Tile tile_of(Image image, ChainExtent extent, float seen)
{
    vec2 size = image.size;
    bvec2 repeats = bvec2(true);
    ivec2 modes = ivec2(image.codes >> 10, image.codes >> 12) & 3;
#if IMAGE_MIRROR
    size *= vec2(modes.x == WRAP_MIRROR ? 2.0 : 1.0, modes.y == WRAP_MIRROR ? 2.0 : 1.0);
#endif
#if IMAGE_ENDS
    repeats = bvec2(modes.x != WRAP_BLACK && (modes.x != WRAP_CLAMP || size.x < 1.5),
                    modes.y != WRAP_BLACK && (modes.y != WRAP_CLAMP || size.y < 1.5));
#endif
    size = extent.alongX ? size : size.yx;
    repeats = extent.alongX ? repeats : repeats.yx;
    float stride = seen / size.x;
    stride = repeats.x && stride > (size.x < 1.5 ? TILE_SINGLE : 1.0) ? stride : 0.0;
    float drift = (extent.lean / extent.square - extent.shear) * size.x;
    drift -= repeats.y ? round(drift / size.y) * size.y : 0.0;
    int level = chain_log2_ceil(max(TILE_ACCESS * stride * abs(drift), CHAIN_FLOOR));
    return Tile(stride, drift, level);
}

// Boxes all over the footprint, in the middle of the one line that is left.
void tile_spread(Tile tile, ChainExtent extent, float accesses, inout ChainCell cell, inout ChainBoxes boxes)
{
    if (tile.stride > 0.0 && cell.count < 2.5) {    // the image's own single texel counts twice where it is mirrored
        float inward = 0.5 - fract(cell.at.x);
        cell.at = vec2(0.5, cell.at.y + extent.lean / extent.square * cell.lines * cell.texel.y * inward);
        cell.count = 1.0 / tile.stride;
        vec2 sides = max(extent.sides * (cell.texel.x * cell.count), vec2(1.0));
        boxes = ChainBoxes(0.5 * (sides.x + sides.y), sides.y, 0.5 - accesses,
                           vec2(0.0, tile.drift * tile.stride * cell.texel.y));
    }
}
#endif
