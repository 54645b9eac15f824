// Fipmap (Bornik and Ferko 2002, section 3.2): per pixel the direction whose chains have the footprint's long side
// along an axis. Twin of fexel/filters/fipmap.py, which says why. Included by image.glsl. Provides filter_fipmap (where
// pixels are boxes; else filter_fipmap_gauss.glsl does), fipmap_sample.
#if defined(IMAGE_LEVELS) && (IMAGE_FILTER_FIPMAP || IMAGE_FILTER_AUTO)

const float FIPMAP_COMPACT = 1.125;
const vec2 FIPMAP_OWN_TILT = vec2(0.3, 0.8);
const vec2 FIPMAP_HALF_TILT = vec2(0.42, 0.68);
const float FIPMAP_CIRCLE = 1.01;
const vec2 FIPMAP_ROWS = vec2(1.45, 1.6);
const vec2 FIPMAP_NARROW = vec2(0.8, 1.6);

// Accesses of compact footprints, texels of level 0 from the centre: in two rows, or in one along the major axis.
struct FipmapPoints {
    vec2 column;      // from one of the two rows' columns to the next
    vec2 single;      // length of the one row
    vec2 zigzag;      // to either side of it
};

FipmapPoints fipmap_points(ChainRows rows, float root, float major, float minor, int level, float accesses)
{
    float difference = 0.5 * (rows.xx - rows.yy);
    vec2 axis = difference >= 0.0 ? vec2(difference + root, rows.xy) : vec2(rows.xy, root - difference);
    // Circles have no axes but what rounding makes of them: they take the pixel's.
    axis = major < FIPMAP_CIRCLE * minor ? vec2(rows.x.x, rows.y.x) : axis;
    axis *= inversesqrt(max(dot(axis, axis), CHAIN_FLOOR));
    float spacing = major * chain_exp2(-level) / accesses;
    float one = clamp((2.0 * spacing - FIPMAP_ROWS.x) / (FIPMAP_ROWS.y - FIPMAP_ROWS.x), 0.0, 1.0);
    float narrow = one * clamp((spacing - FIPMAP_NARROW.x) / (FIPMAP_NARROW.y - FIPMAP_NARROW.x), 0.0, 1.0);
    float boxes = 0.25 * chain_exp2(2 * level) - 0.25;    // variance that the level has beyond level 0, texels^2
    float along = sqrt(max(major * major / 12.0 - boxes, 0.0) * 12.0 / (0.25 * accesses * accesses - 1.0));
    float across = sqrt(max(minor * minor / 12.0 - boxes, 0.0));
    vec2 normal = vec2(-axis.y, axis.x);
    return FipmapPoints((1.0 - one) * along * axis, one * major * axis, (1.0 - narrow) * across * normal);
}

vec2 fipmap_point(FipmapPoints points, float number, float accesses)
{
    float pair = floor(0.5 * number);
    return (pair + 0.5 - 0.25 * accesses) * points.column + ((number + 0.5) / accesses - 0.5) * points.single
         + (1.0 - 2.0 * (number - 2.0 * pair)) * points.zigzag;
}

// Page coordinates of an access, and its weight.
vec3 fipmap_access(ChainCell cell, ChainBoxes boxes, FipmapPoints points, bool compact, float number, float accesses)
{
    vec2 box = chain_box(boxes, number);
    vec2 offset = compact ? fipmap_point(points, number, accesses) * cell.texel : boxes.step * box.x;
    return vec3(chain_page(cell, cell.at + offset), compact ? 1.0 : box.y);
}

// accesses: 4, 6, ... IMAGE_ACCESSES; lod: of the short side.
vec4 fipmap_sample(Image image, vec2 uv, vec2 dx, vec2 dy, float accesses, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    float difference = 0.5 * (rows.xx - rows.yy);
    float root = sqrt(difference * difference + rows.xy * rows.xy);
    float major = sqrt(max(0.5 * (rows.xx + rows.yy) + root, CHAIN_FLOOR));
    float minor = max(rows.area / major, CHAIN_FLOOR);
    int ownLevel = chain_level(minor * minor);
    bool compact = major < FIPMAP_COMPACT * accesses * chain_exp2(ownLevel);

    bool alongX = chain_along_x(rows);
    float square = max(max(rows.xx, rows.yy), CHAIN_FLOOR);
    float tangent = rows.xy / square;
    float steep = abs(tangent);
    int level = chain_level(rows.area / square * rows.area);
    int needed = chain_octaves(chain_sides(rows, alongX), level, accesses);
    bool own = compact || needed <= 0 && steep > FIPMAP_OWN_TILT.x && steep < FIPMAP_OWN_TILT.y;
    bool halves = needed > 1 || steep > FIPMAP_HALF_TILT.x && steep < FIPMAP_HALF_TILT.y;
    int octaves = own ? 0 : halves ? max(needed, 2) : 1;
    float steps = octaves > 2 ? 4.0 : octaves > 1 ? 2.0 : 1.0;
    int quarters = own ? 0 : -int(round(tangent * steps) * (4.0 / steps));
    level = compact ? ownLevel : level;
    lod = float(level);

    ChainExtent extent = chain_extent(image, rows, compact || alongX, quarters * (CHAIN_STEPS / 4));
#if IMAGE_TILES
    Tile tile = tile_of(image, extent, compact ? 0.0 : chain_seen(extent.sides, accesses));
    level = max(level, tile.level);
    lod = float(level);
#endif
    ChainCell cell = chain_cell(image, uv, extent, octaves, level);
    ChainBoxes boxes = chain_boxes(cell, extent, accesses);
#if IMAGE_TILES
    tile_spread(tile, extent, accesses, cell, boxes);
#endif
    FipmapPoints points = fipmap_points(rows, root, major, minor, level, accesses);
    vec4 sum = vec4(0.0);
    float total = 0.0;
#if IMAGE_FILTER_AUTO
    int i = 0;
    do {
        vec3 access = fipmap_access(cell, boxes, points, compact, float(i), accesses);
        float weight = float(i) < accesses ? access.z : 0.0;
        sum += weight * image_page(image, access.xy);
        total += weight;
        ++i;
    } while (float(i) < accesses);
#else
    // Places before accesses, for llvmpipe keeps in memory what it needs beyond one.
    vec3 access[IMAGE_ACCESSES];
    for (int i = 0; i < IMAGE_ACCESSES; ++i)
        access[i] = fipmap_access(cell, boxes, points, compact, float(i), accesses);
    for (int i = 0; i < IMAGE_ACCESSES; ++i) {
        sum += access[i].z * image_page(image, access[i].xy);
        total += access[i].z;
    }
#endif
    LOOKUP_COUNT(4.0 * accesses);
    return sum / total;
}

#if !IMAGE_GAUSS
vec4 filter_fipmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    return fipmap_sample(image, uv, dx, dy, float(IMAGE_ACCESSES), lod);
}
#endif
#endif
