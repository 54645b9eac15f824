// Umbrellas of a place, front to back (Just-in-time texture synthesis 2012, section 6.1): which cover it, and how much of a
// pixel. Included by umbrella.glsl. Provides UmbrellaGrid, UmbrellaPlace, UmbrellaHit, umbrella_list, umbrella_test.
//
// Defines: UMBRELLA_PROJECTIVE 1 where any matrix is; UMBRELLA_MORPHS 1 where shapes do; UMBRELLA_COVERAGES, UMBRELLA_VECTORS
// see umbrella.glsl.
//
// Layout of the float page: fexel/textures/umbrella_texels.py. Addresses are exact in a float: there are less than 2^24.

#define UMBRELLA_TRIES 8                     // rounds of two sectors from the one that the table gives
#define UMBRELLA_AFTER 19                    // vertices that follow again after the last

struct UmbrellaGrid {
    ivec2 page;          // texel of address 0
    int rowBits;
    float bins;          // of a table, over a full turn
    float slices;        // tables of a shape, over the range of the morph
    int stride;          // texels of an entry
    vec2 cells;
};

#if UMBRELLA_DRAWN

struct UmbrellaPlace {
    vec2 inside;         // of a cell, in [0, 1]^2
    vec2 dx;             // cells per pixel
    vec2 dy;
};

vec4 umbrella_texel(UmbrellaGrid grid, int address)
{
    return texelFetch(pagesFloat, grid.page + ivec2(address & ((1 << grid.rowBits) - 1), address >> grid.rowBits), 0);
}

float umbrella_cross(vec2 a, vec2 b)
{
    return a.x * b.y - a.y * b.x;
}

// Grows counter-clockwise from +x; half a turn adds 2. Any value will do for the zero vector.
float umbrella_angle(vec2 v)
{
    float ratio = v.y / max(abs(v.x) + abs(v.y), 1e-30);  // 1e-30 guards the centre
    return v.x < 0.0 ? 2.0 - ratio : ratio < 0.0 ? 4.0 + ratio : ratio;
}

// Where an entry puts a place: patch space about the centre, its derivatives per pixel, shape, morph.
struct UmbrellaPatchPlace {
    vec2 point;
    vec2 dx;
    vec2 dy;
    float number;        // of the first colour, or of the umbrella
    int shape;           // address
    float morph;
    vec3 look;           // coverage, negative where mirrored; cosine, sine
};

UmbrellaPatchPlace umbrella_patch_place(UmbrellaGrid grid, int entry, UmbrellaPlace place)
{
    vec4 rowX = umbrella_texel(grid, entry);
    vec4 rowY = umbrella_texel(grid, entry + 1);
    UmbrellaPatchPlace result;
    result.point = vec2(dot(rowX.xy, place.inside) + rowX.z, dot(rowY.xy, place.inside) + rowY.z);
    result.dx = vec2(dot(rowX.xy, place.dx), dot(rowY.xy, place.dx));
    result.dy = vec2(dot(rowX.xy, place.dy), dot(rowY.xy, place.dy));
    result.number = rowX.w;
    result.shape = int(rowY.w);
    result.morph = 0.0;
    result.look = vec3(1.0, 1.0, 0.0);
#if UMBRELLA_MORPHS || UMBRELLA_COVERAGES || UMBRELLA_VECTORS
    vec4 look = umbrella_texel(grid, entry + grid.stride - 1);
    result.look = look.xyz;
    result.morph = look.w;
#endif
#if UMBRELLA_PROJECTIVE
    vec4 rowW = umbrella_texel(grid, entry + 2);
    bool isAffine = grid.stride == 3;
    float w = isAffine ? 1.0 : dot(rowW.xy, place.inside) + rowW.z;
    rowW.xy = isAffine ? vec2(0.0) : rowW.xy;
    // At or behind infinity the point goes where no umbrella reaches.
    float inverse = w > 0.0 ? 1.0 / w : 0.0;
    result.point = w > 0.0 ? result.point * inverse : vec2(1e15);
    result.dx = (result.dx - result.point * dot(rowW.xy, place.dx)) * inverse;
    result.dy = (result.dy - result.point * dot(rowW.xy, place.dy)) * inverse;
#endif
    return result;
}

// The contour of a shape from a vertex on, about the centre.
vec2 umbrella_vertex(UmbrellaGrid grid, int vertices, float index, float morph)
{
    vec4 vertex = umbrella_texel(grid, vertices + int(index));
#if UMBRELLA_MORPHS
    return vertex.xy + morph * vertex.zw;
#else
    return vertex.xy;
#endif
}

int umbrella_vertices(UmbrellaGrid grid, int shape)
{
    return shape + 1 + int(grid.bins * grid.slices);
}

// The sector that the table gives for a direction: the right one or one before it.
float umbrella_first_sector(UmbrellaGrid grid, UmbrellaPatchPlace at)
{
    float bin = min(floor(umbrella_angle(at.point) * 0.25 * grid.bins), grid.bins - 1.0);
#if UMBRELLA_MORPHS
    bin += grid.bins * min(floor(at.morph * grid.slices), grid.slices - 1.0);
#endif
    return umbrella_texel(grid, at.shape + 1 + int(bin)).x;
}

// What an umbrella shows of a place.
struct UmbrellaHit {
    float coverage;      // share of the pixel, 0 where no sector is
    float sector;
    vec2 place;          // barycentric coordinates of the sector's two contour vertices, within the contour
    vec4 slope;          // their derivatives per pixel, along x and y, as if the sector did not end
};

// One round: two sectors from `sector` on, which becomes the one that holds the point, or where to go on: then `found` is
// false.
UmbrellaHit umbrella_test(UmbrellaGrid grid, UmbrellaPatchPlace at, inout float sector, out bool found)
{
    int vertices = umbrella_vertices(grid, at.shape);
    vec2 middle = umbrella_vertex(grid, vertices, sector + 1.0, at.morph);
    bool second = umbrella_cross(middle, at.point) > 0.0;
    vec2 outer = umbrella_vertex(grid, vertices, second ? sector + 2.0 : sector, at.morph);
    found = !second || umbrella_cross(outer, at.point) <= 0.0;
    sector += !found ? 2.0 : second ? 1.0 : 0.0;
    vec2 from = second ? middle : outer;
    vec2 to = second ? outer : middle;
    float area = umbrella_cross(from, to);
    float inverse = 1.0 / (area > 0.0 ? area : 1.0);
    UmbrellaHit hit;
    hit.sector = sector;
    hit.place = vec2(umbrella_cross(at.point, to), umbrella_cross(from, at.point)) * inverse;
    hit.slope = vec4(umbrella_cross(at.dx, to), umbrella_cross(from, at.dx),
                     umbrella_cross(at.dy, to), umbrella_cross(from, at.dy)) * inverse;
    // A ramp of one pixel across the peripheral edge.
    float sum = hit.place.x + hit.place.y;
    float steepness = length(vec2(hit.slope.x + hit.slope.y, hit.slope.z + hit.slope.w));
    float ramp = (1.0 - sum) / max(steepness, 1e-30) + 0.5;  // 1e-30: where a pixel is a point
    // Beyond a tip, where the edge runs along the ray from the centre, it ends a pixel further along that ray.
    float pixels = length(vec2(umbrella_cross(at.point, at.dy), umbrella_cross(at.dx, at.point)));
    float reach = pixels / max(abs(umbrella_cross(at.dx, at.dy)), 1e-30) * max(1.0 - 1.0 / max(sum, 1e-30), 0.0);
    ramp = clamp(min(ramp, 1.0 - reach), 0.0, 1.0);
    // Rounding may put the point beside a spoke, not further: there no sector sees it from the centre.
    hit.coverage = found && area > 0.0 && min(hit.place.x, hit.place.y) >= -1e-5 ? ramp : 0.0;
#if UMBRELLA_COVERAGES
    hit.coverage *= abs(at.look.x);
#endif
    hit.place /= max(sum, 1.0);
    return hit;
}
#endif
