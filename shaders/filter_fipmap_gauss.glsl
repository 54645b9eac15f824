// Fipmap that weights a footprint by a Gaussian of a standard deviation of half a pixel, as EWA does, in place of the
// box of a pixel. Twin of fexel/filters/fipmap.py and lookup.py (gauss=True). Included by image.glsl after
// filter_fipmap.glsl. Provides filter_fipmap.
#if defined(IMAGE_LEVELS) && IMAGE_FILTER_FIPMAP && IMAGE_GAUSS

const float GAUSS_ACCESSES = float(IMAGE_ACCESSES);
const float GAUSS_COMPACT = 2.0;             // texels of its level, up to which a footprint is seen in the image's own
const float GAUSS_TEXEL = 1.0 / 12.0;        // variance of a texel, which is a box, texels^2
const float GAUSS_LEAST_VARIANCE = 0.01;     // keeps weights finite
const int GAUSS_MOST_HALVINGS = 4;           // of the steps of directions: CHAIN_STEPS is 2 to the power of it

// A standard deviation to either side along both axes of the ellipse, texels of level 0.
struct GaussPoints {
    vec2 along;
    vec2 across;
};

GaussPoints gauss_points(ChainRows rows, float root, float major, float minor)
{
    float difference = 0.5 * (rows.xx - rows.yy);
    vec2 axis = difference >= 0.0 ? vec2(difference + root, rows.xy) : vec2(rows.xy, root - difference);
    // Circles have no axes but what rounding makes of them: they take the pixel's.
    axis = major < FIPMAP_CIRCLE * minor ? vec2(rows.x.x, rows.y.x) : axis;
    axis *= 0.5 * inversesqrt(max(dot(axis, axis), CHAIN_FLOOR));
    return GaussPoints(major * axis, minor * vec2(-axis.y, axis.x));
}

vec4 filter_fipmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    float difference = 0.5 * (rows.xx - rows.yy);
    float root = sqrt(difference * difference + rows.xy * rows.xy);
    float major = sqrt(max(0.5 * (rows.xx + rows.yy) + root, CHAIN_FLOOR));
    float minor = max(rows.area / major, CHAIN_FLOOR);
    int ownLevel = chain_level(minor * minor);
    bool compact = major < GAUSS_COMPACT * chain_exp2(ownLevel);

    bool alongX = chain_along_x(rows);
    float square = max(max(rows.xx, rows.yy), CHAIN_FLOOR);
    float tangent = rows.xy / square;
    float steep = abs(tangent);
    int level = chain_level(rows.area / square * rows.area);
    int needed = chain_log2_ceil(sqrt(square) / GAUSS_ACCESSES) - level;
    bool own = compact || needed <= 0 && steep > FIPMAP_OWN_TILT.x && steep < FIPMAP_OWN_TILT.y;
    bool halves = needed > 1 || steep > FIPMAP_HALF_TILT.x && steep < FIPMAP_HALF_TILT.y;
    int octaves = own ? 0 : halves ? max(needed, 2) : 1;
    int step = CHAIN_STEPS >> clamp(octaves - 1, 0, GAUSS_MOST_HALVINGS);
    int shear = own ? 0 : -int(round(tangent * float(CHAIN_STEPS / step))) * step;
    level = compact ? ownLevel : level;
    lod = float(level);

    ChainExtent extent = chain_extent(image, rows, compact || alongX, shear);
#if IMAGE_TILES
    Tile tile = tile_of(image, extent, compact ? 0.0 : length(extent.sides) / GAUSS_ACCESSES);
    level = max(level, tile.level);
    lod = float(level);
#endif
    ChainCell cell = chain_cell(image, uv, extent, octaves, level);
    ChainBoxes boxes = chain_boxes(cell, extent, GAUSS_ACCESSES);
#if IMAGE_TILES
    tile_spread(tile, extent, GAUSS_ACCESSES, cell, boxes);
#endif
    GaussPoints points = gauss_points(rows, root, major, minor);
    vec2 sides = extent.sides * (cell.texel.x * cell.count);
    float falloff = -0.5 / max(0.25 * dot(sides, sides) - GAUSS_TEXEL, GAUSS_LEAST_VARIANCE);
    // Places before accesses, for llvmpipe keeps in memory what it needs beyond one.
    vec3 access[IMAGE_ACCESSES];
    for (int i = 0; i < IMAGE_ACCESSES; ++i) {
        float left = boxes.first + 2.0 * float(i);
        float near = exp(falloff * left * left);
        float both = near + exp(falloff * (left + 1.0) * (left + 1.0));
        vec2 chained = boxes.step * (left + 1.0 - near / max(both, CHAIN_FLOOR));
        vec2 corner = (i & 2) == 0 ? -points.along : points.along;
        corner += (i & 1) == 0 ? -points.across : points.across;
        float weight = compact ? (i < 4 ? 1.0 : 0.0) : both;
        access[i] = vec3(chain_page(cell, cell.at + (compact ? corner * cell.texel : chained)), weight);
    }
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int i = 0; i < IMAGE_ACCESSES; ++i) {
        sum += access[i].z * image_page(image, access[i].xy);
        total += access[i].z;
    }
    LOOKUP_COUNT(4.0 * GAUSS_ACCESSES);
    return sum / total;
}
#endif
