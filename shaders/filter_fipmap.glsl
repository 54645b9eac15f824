// Fipmap (Bornik and Ferko 2002, section 3.2): per pixel the direction whose chains have the footprint's long side along an
// axis. Twin of fexel/filters/fipmap.py, which says why. Included by image.glsl. Provides filter_fipmap, fipmap_sample.
#if defined(IMAGE_LEVELS) && IMAGE_FILTER_FIPMAP

const float FIPMAP_COMPACT = 5.0;
const vec2 FIPMAP_OWN_TILT = vec2(0.3, 0.68);
const vec2 FIPMAP_HALF_TILT = vec2(0.42, 0.68);
const vec2 FIPMAP_ROUND = vec2(2.3, 2.6);
const float FIPMAP_NARROW = 2.5;

// Offsets of the accesses of compact footprints: signs times (along, across), and `row` times their places in a row.
struct FipmapCompact {
    vec2 along;
    vec2 across;
    vec2 row;
};

FipmapCompact fipmap_compact(ChainRows rows, float root, float major, float minor, int level)
{
    float difference = 0.5 * (rows.xx - rows.yy);
    vec2 axis = difference >= 0.0 ? vec2(difference + root, rows.xy) : vec2(rows.xy, root - difference);
    float size = dot(axis, axis);
    axis = size > 0.0 ? axis * inversesqrt(size) : vec2(1.0, 0.0);
    float ratio = major / minor;
    float row = clamp((ratio - FIPMAP_ROUND.x) / (FIPMAP_ROUND.y - FIPMAP_ROUND.x), 0.0, 1.0);
    float narrow = row * clamp((ratio - FIPMAP_ROUND.y) / FIPMAP_NARROW, 0.0, 1.0);
    float boxes = 0.25 * chain_exp2(2 * level) - 0.25;    // variance that the level has beyond level 0, texels^2
    float along = sqrt(max(major * major / 12.0 - boxes, 0.0));
    float across = sqrt(max(minor * minor / 12.0 - boxes, 0.0));
    return FipmapCompact((1.0 - row) * along * axis, (1.0 - narrow) * across * vec2(-axis.y, axis.x), row * major * axis);
}

// accesses: along the long axis, 4 to IMAGE_ACCESSES; lod: of the short side.
vec4 fipmap_sample(Image image, vec2 uv, vec2 dx, vec2 dy, float accesses, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    float difference = 0.5 * (rows.xx - rows.yy);
    float root = sqrt(difference * difference + rows.xy * rows.xy);
    float major = sqrt(max(0.5 * (rows.xx + rows.yy) + root, CHAIN_FLOOR));
    float minor = max(rows.area / major, CHAIN_FLOOR);
    int ownLevel = chain_level(minor);
    bool compact = major < FIPMAP_COMPACT * chain_exp2(ownLevel);

    bool alongX = rows.xx >= rows.yy;
    float square = max(max(rows.xx, rows.yy), CHAIN_FLOOR);
    float tangent = rows.xy / square;
    float steep = abs(tangent);
    int level = chain_level(rows.area * inversesqrt(square));
    int needed = chain_octaves(chain_sides(rows, alongX), level, accesses);
    bool own = compact || needed <= 0 && steep > FIPMAP_OWN_TILT.x && steep < FIPMAP_OWN_TILT.y;
    bool halves = needed > 1 || steep > FIPMAP_HALF_TILT.x && steep < FIPMAP_HALF_TILT.y;
    int octaves = own ? 0 : halves ? max(needed, 2) : 1;
    float steps = octaves > 2 ? 4.0 : octaves > 1 ? 2.0 : 1.0;
    int quarters = own ? 0 : -int(round(tangent * steps) * (4.0 / steps));
    level = compact ? ownLevel : level;

    ChainExtent extent = chain_extent(image, rows, compact || alongX, quarters);
    ChainCell cell = chain_cell(image, uv, extent, octaves, level);
    ChainBoxes boxes = chain_boxes(cell, extent, accesses);
    FipmapCompact points = fipmap_compact(rows, root, major, minor, level);
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int i = 0; i < IMAGE_ACCESSES; ++i) {
        vec2 point = (i < 2 ? -1.0 : 1.0) * points.along + (i % 2 == 0 ? 1.0 : -1.0) * points.across
                   + (0.25 * float(i) - 0.375) * points.row;
        vec2 box = chain_box(boxes, float(i));
        float weight = compact ? i < 4 ? 1.0 : 0.0 : float(i) < accesses ? box.y : 0.0;
        sum += weight * chain_access(image, cell, cell.at + (compact ? point * cell.texel : boxes.step * box.x));
        total += weight;
    }
    lod = float(level);
    LOOKUP_COUNT(4.0 * max(accesses, 4.0));
    return sum / total;
}

vec4 filter_fipmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    return fipmap_sample(image, uv, dx, dy, float(IMAGE_ACCESSES), lod);
}
#endif
