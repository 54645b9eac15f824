// Lookups in chains of prefiltered images (fexel/filters/chain.py). Included by image.glsl, for ripmap and fipmap.
// Provides ChainRows, chain_rows, chain_along_x, chain_level, chain_seen, chain_octaves, ChainExtent, chain_plain,
// chain_extent, ChainCell, chain_cell, chain_page, ChainBoxes, chain_boxes, chain_box. Twin of fexel/filters/lookup.py.
//
// A footprint is moved along a direction (fexel/filters/shears.py). A cell of that direction has texels that are
// 2^level wide along the axis that is moved, and 2^octaves longer along the other one, the long axis. Vectors of what
// is moved have the long axis first; places are in periods of the cell, or parts of it where it does not repeat.
//
// Defines: IMAGE_ACCESSES bilinear accesses of a lookup; IMAGE_GAUSS 1 where pixels are Gaussians; IMAGE_WRAPS,
// IMAGE_ENDS, IMAGE_MIRROR 1 where any image repeats along an axis, ends there, or is mirrored.
// The table of an image is described in fexel/filters/chain_table.py.
#if defined(IMAGE_LEVELS) && IMAGE_CHAINS

const float CHAIN_LARGEST = 1e9;    // texels per pixel, what the whole image is seen by
const float CHAIN_WHOLE = 1e5;      // images per pixel: more, or not a number, is the whole image
// As fexel/filters/lookup.py has them, which says what for.
const float CHAIN_LIFT = 1.5;
const float CHAIN_RAMP = 0.5;
const float CHAIN_SLACK = 0.25;
const float CHAIN_EQUAL = 1.0001;
const float CHAIN_FLOOR = 1e-30;
const float CHAIN_SEAM = 1e-5;
// Of 1 in the shears that the table has: from -1 to 1, per long axis.
#if IMAGE_GAUSS
const int CHAIN_STEPS = 16;
#else
const int CHAIN_STEPS = 4;
#endif
const int CHAIN_SLANTS = 2 * (2 * CHAIN_STEPS + 1);

// Rows of the Jacobian in texels of level 0, x right and y down (how much x and y change per pixel along x and y),
// their squares and product, and the area of the footprint.
struct ChainRows {
    vec2 x;
    vec2 y;
    float xx;
    float yy;
    float xy;
    float area;
};

ChainRows chain_rows(Image image, vec2 dx, vec2 dy)
{
    vec2 x = vec2(dx.x, dy.x) * image.size.x;
    vec2 y = vec2(dx.y, dy.y) * -image.size.y;
    bool fits = (abs(dx.x) + abs(dx.y)) + (abs(dy.x) + abs(dy.y)) < CHAIN_WHOLE;
    x = fits ? x : vec2(CHAIN_LARGEST, 0.0);
    y = fits ? y : vec2(0.0, CHAIN_LARGEST);
    return ChainRows(x, y, dot(x, x), dot(y, y), dot(x, y), abs(x.x * y.y - x.y * y.x));
}

// Whether the long axis is x; so it is where but for rounding both are equal.
bool chain_along_x(ChainRows rows)
{
    return rows.yy <= CHAIN_EQUAL * rows.xx;
}

// floor(log2(x)) and ceil(log2(x)), exactly, of x > 0; of 0 far below 0.
int chain_log2_floor(float x)
{
    return (floatBitsToInt(x) >> 23) - 127;
}

int chain_log2_ceil(float x)
{
    return ((floatBitsToInt(x) - 1) >> 23) - 126;
}

float chain_exp2(int x)
{
    return intBitsToFloat((x + 127) << 23);
}

// The coarsest level of which a width is CHAIN_LIFT texels at least; given the width squared, texels^2 of level 0.
int chain_level(float square)
{
    return max(chain_log2_floor(square * (1.0 / (CHAIN_LIFT * CHAIN_LIFT))) >> 1, 0);
}

vec2 chain_sides(ChainRows rows, bool alongX)
{
    vec2 x = abs(rows.x);
    vec2 y = abs(rows.y);
    return alongX ? vec2(max(x.x, x.y), min(x.x, x.y)) : vec2(max(y.x, y.y), min(y.x, y.y));
}

// Texels of level 0 that a box is long of which a footprint is as long as so many accesses can read.
float chain_seen(vec2 sides, float accesses)
{
    return (sides.x + CHAIN_RAMP * sides.y) / (2.0 * accesses + CHAIN_SLACK);
}

// By how many octaves a texel must be longer than wide, for so many accesses to do; may be negative.
int chain_octaves(vec2 sides, int level, float accesses)
{
    return chain_log2_ceil((sides.x + CHAIN_RAMP * sides.y) / (2.0 * accesses + CHAIN_SLACK)) - level;
}

// What a footprint measures once it is moved along a direction of the table.
struct ChainExtent {
    vec2 sides;       // of the parallelogram along the long axis, texels of level 0, the longer first
    float square;     // of its length along the long axis, texels^2
    float lean;       // times what is left of its slope: texels along the moved axis per texel along the long one
    float shear;
    bool alongX;
    int cells;        // of the direction, in the record texture
    int fewest;       // octaves that it has
};

// Of the directions that move nothing: their cells come first, whatever else there is.
ChainExtent chain_plain(Image image, ChainRows rows, bool alongX)
{
    int codes = int(image.table.y);
    int row = ((codes >> 8) + 1) << ((codes >> 4) & 15);
    float square = max(alongX ? rows.xx : rows.yy, CHAIN_FLOOR);
    return ChainExtent(chain_sides(rows, alongX), square, rows.xy, 0.0, alongX, int(image.table.x) + CHAIN_SLANTS + (alongX ? 0 : row), 0);
}

// steps: CHAIN_STEPS times the shear that is asked for.
ChainExtent chain_extent(Image image, ChainRows rows, bool alongX, int steps)
{
    int table = int(image.table.x);
    vec4 entry = record_fetch(table + (alongX ? CHAIN_STEPS : 3 * CHAIN_STEPS + 1) + steps);
    alongX = entry.w > 0.0;
    float square = max(alongX ? rows.xx : rows.yy, CHAIN_FLOOR);
    return ChainExtent(chain_sides(rows, alongX), square, rows.xy + entry.x * square, entry.x, alongX, table + int(entry.y), int(entry.z));
}

struct ChainCell {
    vec2 at;          // of the pixel
    vec2 texel;       // periods per texel of level 0
    float lines;      // texels of level 0 in a period of the long axis
    float count;      // and of the cell
    vec2 begin;       // page coordinates of the cell's first texel
    vec2 size;        // and of a period
    float jump;       // periods of the moved axis per period of the long one
    bool alongX;
#if IMAGE_ENDS
    bvec2 ends;       // where it does not repeat
    vec2 halfTexel;   // of the cell
#endif
#if IMAGE_MIRROR
    bvec2 folds;      // the second half of a period is the first one, reversed
#endif
};

ChainCell chain_cell(Image image, vec2 uv, ChainExtent extent, int octaves, int level)
{
    int codes = int(image.table.y);
    int bits = (codes >> 4) & 15;
    int row = clamp(octaves, extent.fewest, codes >> 8) << bits;
    vec4 place = record_fetch(extent.cells + row + clamp(level - (codes & 15), 0, (1 << bits) - 1));
    bool alongX = extent.alongX;
    vec2 page = alongX ? image.table.zw : image.table.wz;
    ChainCell cell;
    cell.alongX = alongX;
    cell.size = abs(place.xy);
    cell.begin = place.zw;
    cell.count = place.x * page.x;
    vec2 at = vec2(uv.x, 1.0 - uv.y);
    vec2 size = image.size;
#if IMAGE_ENDS || IMAGE_MIRROR
    ivec2 modes = ivec2(image.codes >> 10, image.codes >> 12) & 3;
#endif
#if IMAGE_MIRROR
    vec2 halves = vec2(modes.x == WRAP_MIRROR ? 2.0 : 1.0, modes.y == WRAP_MIRROR ? 2.0 : 1.0);
    at /= halves;
    size *= halves;
    bvec2 mirrored = alongX ? bvec2(modes.x == WRAP_MIRROR, modes.y == WRAP_MIRROR) : bvec2(modes.y == WRAP_MIRROR, modes.x == WRAP_MIRROR);
    cell.folds = bvec2(mirrored.x && extent.shear == 0.0, mirrored.y && extent.shear == 0.0);
#endif
    at = alongX ? at : at.yx;
    size = alongX ? size : size.yx;
    vec2 whole = floor(at);    // left out before anything is multiplied
#if IMAGE_ENDS
    bvec2 ends = bvec2(modes.x == WRAP_CLAMP || modes.x == WRAP_BLACK, modes.y == WRAP_CLAMP || modes.y == WRAP_BLACK);
    cell.ends = alongX ? ends : ends.yx;
    whole = vec2(cell.ends.x ? 0.0 : whole.x, cell.ends.y ? 0.0 : whole.y);
#endif
    at -= whole;
    at = vec2(abs(at.x) < CHAIN_LARGEST ? at.x : 0.0, abs(at.y) < CHAIN_LARGEST ? at.y : 0.0);
#if IMAGE_ENDS
    cell.halfTexel = 0.5 / (page * cell.size);
    at.y *= size.y;
    float pad = extent.shear * (size.x - 1.0);    // of the moved axis, where it does not repeat
    at.y += cell.ends.y ? ceil(max(-pad, 0.0)) : 0.0;
    size.y += cell.ends.y ? ceil(abs(pad)) : 0.0;
    cell.texel = size.yx * (1.0 / (size.x * size.y));
    at.y *= cell.texel.y;
    cell.halfTexel.y += place.y < 0.0 ? cell.texel.y : 0.0;    // a texel more, over which it fades
#else
    cell.texel = size.yx * (1.0 / (size.x * size.y));
#endif
    cell.lines = size.x;
    cell.jump = extent.shear * size.x * cell.texel.y;
    cell.at = vec2(at.x, at.y + cell.jump * at.x - 0.5 * extent.shear * cell.texel.y);
    return cell;
}

// Page coordinates of an access; its moved coordinate is as if the long one needed no wrapping.
vec2 chain_page(ChainCell cell, vec2 at)
{
    float whole = floor(at.x + CHAIN_SEAM);
#if IMAGE_ENDS
    whole = cell.ends.x ? at.x - clamp(at.x, -cell.halfTexel.x, 1.0 + cell.halfTexel.x) : whole;
#endif
    at -= vec2(1.0, cell.jump) * whole;
#if IMAGE_ENDS
    at.y = cell.ends.y ? clamp(at.y, -cell.halfTexel.y, 1.0 + cell.halfTexel.y) : at.y - floor(at.y);
#else
    at.y -= floor(at.y);
#endif
#if IMAGE_MIRROR
    at.x = cell.folds.x ? min(at.x, 1.0 - at.x) : at.x;
    at.y = cell.folds.y ? min(at.y, 1.0 - at.y) : at.y;
#endif
    vec2 page = cell.begin + cell.size * at;
    return cell.alongX ? page : page.yx;
}

// A trapezoid along the long axis: of the footprint, convolved with a texel. Two neighbouring texels are one access.
struct ChainBoxes {
    float reach;      // from its middle to where it ends, in texels of the cell
    float height;     // and in that unit the length of each end
    float first;      // centre of the first texel, from the middle, in texels of the cell
    vec2 step;        // periods per texel of the cell
};

ChainBoxes chain_boxes(ChainCell cell, ChainExtent extent, float accesses)
{
    vec2 sides = max(extent.sides * (cell.texel.x * cell.count), vec2(1.0));
    float middle = cell.at.x * cell.count;
    float inverse = 1.0 / (extent.square * cell.count);
    return ChainBoxes(0.5 * (sides.x + sides.y), sides.y, floor(middle - accesses + 0.5) + (0.5 - middle),
                      vec2(extent.square, extent.lean * cell.lines * cell.texel.y) * inverse);
}

// An access: its offset along the long axis, in texels of the cell, and its weight.
vec2 chain_box(ChainBoxes boxes, float number)
{
    float left = boxes.first + 2.0 * number;
    float near = clamp(boxes.reach - abs(left), 0.0, boxes.height);
    float far = clamp(boxes.reach - abs(left + 1.0), 0.0, boxes.height);
    float both = near + far;
    return vec2(left + far / max(both, 1e-6), both);    // 1e-6: what has no weight is anywhere
}

#endif
