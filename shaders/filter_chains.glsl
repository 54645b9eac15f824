// Lookups in chains of prefiltered images (fexel/filters/chain.py). Included by image.glsl, for ripmap and fipmap.
// Provides ChainRows, chain_rows, chain_level, chain_octaves, ChainExtent, chain_extent, ChainPlace, chain_place, chain_access,
// ChainBoxes, chain_boxes, chain_box. Twin of fexel/filters/lookup.py.
//
// A footprint is moved along a direction (fexel/filters/shears.py). A cell of that direction has texels that are 2^level
// wide along the axis that is moved, and 2^octaves longer along the other one, the long axis.
//
// Defines: IMAGE_ACCESSES bilinear accesses of a lookup; IMAGE_WRAPS 0 where all images clamp; IMAGE_MIRROR 1 where any is
// mirrored. The table of an image is described in fexel/filters/chain_table.py.
#if defined(IMAGE_LEVELS) && IMAGE_CHAINS

const float CHAIN_LARGEST = 1e9;    // texels per pixel: more, or not a number, is the whole image
// As fexel/filters/lookup.py has them, which says what for.
const float CHAIN_LIFT = 1.5;
const float CHAIN_RAMP = 0.5;
const float CHAIN_SLACK = 0.25;
const float CHAIN_FLOOR = 1e-30;    // keeps logarithms and quotients finite where the Jacobian is 0

// Rows of the Jacobian in texels of level 0, x right and y down (how much x and y change per pixel along x and y), their
// squares and product, and the area of the footprint.
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
    bool fits = all(lessThan(abs(vec4(x, y)), vec4(CHAIN_LARGEST)));
    x = fits ? x : vec2(CHAIN_LARGEST, 0.0);
    y = fits ? y : vec2(0.0, CHAIN_LARGEST);
    return ChainRows(x, y, dot(x, x), dot(y, y), dot(x, y), abs(x.x * y.y - x.y * y.x));
}

// The coarsest level of which a width in texels of level 0 is CHAIN_LIFT texels at least.
float chain_level(float across)
{
    return max(floor(log2(max(across, CHAIN_FLOOR) / CHAIN_LIFT)), 0.0);
}

vec2 chain_sides(ChainRows rows, bool alongX)
{
    vec2 sides = abs(alongX ? rows.x : rows.y);
    return vec2(max(sides.x, sides.y), min(sides.x, sides.y));
}

// By how many octaves a texel must be longer than wide, for so many accesses to do; may be negative.
float chain_octaves(vec2 sides, float level, float accesses)
{
    return ceil(log2(max(sides.x + CHAIN_RAMP * sides.y, CHAIN_FLOOR) / (2.0 * accesses + CHAIN_SLACK))) - level;
}

// What a footprint measures once it is moved along a direction of the table.
struct ChainExtent {
    vec2 sides;       // of the parallelogram along the long axis, texels of level 0, the longer first
    float tilt;       // what is left of its slope: texels along the moved axis per texel along the long one
    float shear;
    bool alongX;
    int cells;        // of the direction, in the record texture
    float fewest;     // octaves that it has
};

// quarters: 4 times the shear that is asked for.
ChainExtent chain_extent(Image image, ChainRows rows, bool alongX, float quarters)
{
    vec4 entry = record_fetch(int(image.table.x) + (alongX ? 4 : 13) + int(quarters));
    alongX = entry.w > 0.0;
    vec2 sides = chain_sides(rows, alongX);
    float tangent = rows.xy / max(alongX ? rows.xx : rows.yy, CHAIN_FLOOR);
    return ChainExtent(sides, tangent + entry.x, entry.x, alongX, int(image.table.w) + int(entry.y), entry.z);
}

// A place in a cell: (along the long axis, along the moved one), in texels of the cell.
struct ChainPlace {
    vec2 at;          // of the pixel
    vec2 scale;       // texels of the cell per texel of level 0
    vec2 begin;       // page texels of the cell's first texel
    vec2 end;         // of the cell, where it does not repeat
    vec2 period;      // after which it repeats; 0 where it does not
    float jump;       // of the moved axis, per texel along the long one
    bvec2 folds;      // mirrored: the second half of a period is the first one, reversed
    bool alongX;
};

ChainPlace chain_place(Image image, vec2 uv, ChainExtent extent, float octaves, float level)
{
    int codes = int(image.table.y);
    int levels = (codes >> 4) & 15;
    int row = int(clamp(octaves, extent.fewest, float(codes >> 8))) * levels;
    vec4 cell = record_fetch(extent.cells + row + clamp(int(min(level, 15.0)) - (codes & 15), 0, levels - 1));
    vec2 size = extent.alongX ? image.size : image.size.yx;
    vec2 position = vec2(abs(uv.x) < CHAIN_LARGEST ? uv.x : 0.0, abs(uv.y) < CHAIN_LARGEST ? 1.0 - uv.y : 0.0);
    position = extent.alongX ? position : position.yx;
    vec2 period = vec2(0.0);
    float lines = size.x;
#if IMAGE_WRAPS
    // Whole periods are left out before anything is multiplied.
    ivec2 modes = ivec2(image.codes >> 10, image.codes >> 12) & 3;
    modes = extent.alongX ? modes : modes.yx;
    period = vec2(modes.x == WRAP_REPEAT ? 1.0 : modes.x == WRAP_MIRROR ? 2.0 : 0.0,
                  modes.y == WRAP_REPEAT ? 1.0 : modes.y == WRAP_MIRROR ? 2.0 : 0.0);
    position -= period * floor(position / max(period, vec2(0.5)));
    lines *= max(period.x, 1.0);
#endif
    position *= size;
    float padding = extent.shear * (lines - 1.0);    // of the moved axis, where it does not repeat
    float before = period.y > 0.0 ? 0.0 : ceil(max(-padding, 0.0));
    vec2 at = vec2(position.x, position.y + extent.shear * (position.x - 0.5) + before) * cell.xy;
    vec2 end = vec2(size.x, size.y + ceil(abs(padding))) * cell.xy + 0.5;
    bvec2 folds = bvec2(extent.shear == 0.0 && period.x == 2.0, extent.shear == 0.0 && period.y == 2.0);
    return ChainPlace(at, cell.xy, cell.zw, end, period * size * cell.xy, extent.shear * cell.y / cell.x, folds, extent.alongX);
}

// One bilinear access; its moved coordinate is as if the long one needed no wrapping.
vec4 chain_access(Image image, ChainPlace cell, vec2 at)
{
    vec2 place = at;
#if IMAGE_WRAPS
    vec2 inverse = 1.0 / max(cell.period, vec2(1e-6));    // 1e-6: where nothing repeats, what follows is not used
    place.x = cell.period.x > 0.0 ? place.x - cell.period.x * floor(place.x * inverse.x) : clamp(place.x, -0.5, cell.end.x);
    place.y -= cell.jump * (at.x - place.x);
    place.y = cell.period.y > 0.0 ? place.y - cell.period.y * floor(place.y * inverse.y) : clamp(place.y, -0.5, cell.end.y);
#else
    place.x = clamp(place.x, -0.5, cell.end.x);
    place.y = clamp(place.y - cell.jump * (at.x - place.x), -0.5, cell.end.y);
#endif
#if IMAGE_MIRROR
    place.x = cell.folds.x ? min(place.x, cell.period.x - place.x) : place.x;
    place.y = cell.folds.y ? min(place.y, cell.period.y - place.y) : place.y;
#endif
    vec2 page = cell.begin + place;
    return image_page(image, 2.0 * image_half_texel(image) * (cell.alongX ? page : page.yx));
}

// A trapezoid along the long axis: of the footprint, convolved with a texel. Two neighbouring texels are one access.
struct ChainBoxes {
    float reach;      // from its middle to where it ends, in lengths of such an end
    float ramp;       // by how much each end falls per texel of the cell
    float first;      // centre of the first texel, from the middle
    float lean;       // tilt, in texels of the cell
};

ChainBoxes chain_boxes(ChainPlace cell, ChainExtent extent, float accesses)
{
    vec2 sides = max(extent.sides * cell.scale.x, vec2(1.0));
    return ChainBoxes(0.5 * (sides.x + sides.y) / sides.y, 1.0 / sides.y, round(cell.at.x - accesses) + 0.5 - cell.at.x,
                      extent.tilt * cell.scale.y / cell.scale.x);
}

// An access: its offset along the long axis, and its weight.
vec2 chain_box(ChainBoxes boxes, float number)
{
    float left = boxes.first + 2.0 * number;
    float near = clamp(boxes.reach - abs(left) * boxes.ramp, 0.0, 1.0);
    float far = clamp(boxes.reach - abs(left + 1.0) * boxes.ramp, 0.0, 1.0);
    float both = near + far;
    return vec2(left + far / max(both, 1e-6), both);    // 1e-6: what has no weight is anywhere
}

#endif
