// Fipmap (Bornik and Ferko 2002, section 3.2): per pixel the direction whose chains have the footprint's long side along an
// axis. Twin of fexel/filters/fipmap.py, which says why. Included by image.glsl. Provides filter_fipmap, fipmap_sample.
#if defined(IMAGE_LEVELS) && IMAGE_FILTER_FIPMAP

const float FIPMAP_COMPACT = 5.0;
const vec2 FIPMAP_OWN_TILT = vec2(0.3, 0.68);
const vec2 FIPMAP_HALF_TILT = vec2(0.42, 0.68);
const vec2 FIPMAP_ROUND = vec2(2.3, 2.6);

bool fipmap_between(float tangent, vec2 bounds)
{
    return tangent > bounds.x && tangent < bounds.y;
}

// Offsets of the accesses of compact footprints: signs times (along, across), and `row` times their places in a row.
struct FipmapCompact {
    vec2 along;
    vec2 across;
    vec2 row;
};

FipmapCompact fipmap_compact(ChainRows rows, float root, float major, float minor, float level)
{
    float difference = 0.5 * (rows.xx - rows.yy);
    vec2 axis = difference >= 0.0 ? vec2(difference + root, rows.xy) : vec2(rows.xy, root - difference);
    float size = dot(axis, axis);
    axis = size > 0.0 ? axis * inversesqrt(size) : vec2(1.0, 0.0);
    float ratio = major / minor;
    float row = clamp((ratio - FIPMAP_ROUND.x) / (FIPMAP_ROUND.y - FIPMAP_ROUND.x), 0.0, 1.0);
    float narrow = row * clamp((ratio - FIPMAP_ROUND.y) / 2.5, 0.0, 1.0);
    float boxes = 0.25 * exp2(2.0 * level) - 0.25;    // variance that the level has beyond level 0, texels^2
    float along = sqrt(max(major * major / 12.0 - boxes, 0.0));
    float across = sqrt(max(minor * minor / 12.0 - boxes, 0.0));
    return FipmapCompact((1.0 - row) * along * axis, (1.0 - narrow) * across * vec2(-axis.y, axis.x), row * major * axis);
}

// probes: accesses along the long axis, 4 to IMAGE_ACCESSES; lod: of the short side.
vec4 fipmap_sample(Image image, vec2 uv, vec2 dx, vec2 dy, float probes, out float lod)
{
    ChainRows rows = chain_rows(image, dx, dy);
    float difference = 0.5 * (rows.xx - rows.yy);
    float root = sqrt(difference * difference + rows.xy * rows.xy);
    float major = sqrt(max(0.5 * (rows.xx + rows.yy) + root, CHAIN_FLOOR));
    float minor = max(rows.area / major, CHAIN_FLOOR);
    float ownLevel = chain_level(minor);
    bool compact = major < FIPMAP_COMPACT * exp2(ownLevel);

    bool alongX = rows.xx >= rows.yy;
    float square = max(max(rows.xx, rows.yy), CHAIN_FLOOR);
    float longest = sqrt(square);
    float tangent = rows.xy / square;
    float level = chain_level(rows.area / longest);
    float needed = chain_octaves(chain_sides(rows, alongX), level, probes);
    bool own = compact || needed <= 0.0 && fipmap_between(abs(tangent), FIPMAP_OWN_TILT);
    bool halves = needed > 1.0 || fipmap_between(abs(tangent), FIPMAP_HALF_TILT);
    float octaves = own ? 0.0 : halves ? max(needed, 2.0) : 1.0;
    float steps = octaves > 2.0 ? 4.0 : octaves > 1.0 ? 2.0 : 1.0;
    float quarters = own ? 0.0 : -round(tangent * steps) * (4.0 / steps);
    lod = compact ? ownLevel : level;

    ChainExtent extent = chain_extent(image, rows, compact || alongX, quarters);
    ChainPlace cell = chain_place(image, uv, extent, octaves, lod);
    ChainBoxes boxes = chain_boxes(cell, extent, probes);
    FipmapCompact points = fipmap_compact(rows, root, major, minor, lod);
    points.along *= cell.scale;
    points.across *= cell.scale;
    points.row *= cell.scale;
    vec4 sum = vec4(0.0);
    float total = 0.0;
    for (int i = 0; i < IMAGE_ACCESSES; ++i) {
        vec2 point = cell.at + (i < 2 ? -1.0 : 1.0) * points.along + (i % 2 == 0 ? 1.0 : -1.0) * points.across
                   + (0.25 * float(i) - 0.375) * points.row;
        vec2 box = chain_box(boxes, float(i));
        float weight = compact ? i < 4 ? 1.0 : 0.0 : float(i) < probes ? box.y : 0.0;
        sum += weight * chain_access(image, cell, compact ? point : cell.at + vec2(1.0, boxes.lean) * box.x);
        total += weight;
    }
    LOOKUP_COUNT(4.0 * max(probes, 4.0));
    return sum / total;
}

vec4 filter_fipmap(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    return fipmap_sample(image, uv, dx, dy, float(IMAGE_ACCESSES), lod);
}
#endif
