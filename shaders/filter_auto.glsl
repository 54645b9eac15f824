// Per footprint the filter that its image's table names: the cheapest one whose predicted error is small enough.
// Twin and table: plugin/fexel/filters/auto.py. Included by image.glsl after the filters that it calls.
// Provides filter_auto.
//
// Table, behind the image's own record: a texel per sector of the major axis and two minor axes; of each minor axis two
// components of eight ratios, three bits each.

#if defined(IMAGE_LEVELS) && IMAGE_FILTER_AUTO

const int AUTO_SECTORS = 16;       // of half a turn, from -45 degrees on: tangents to the nearer axis in steps of 1/4
const int AUTO_RATIOS = 16;        // half octaves from 1 on
const int AUTO_MINORS = 14;        // half octaves from half a texel on
// Candidates: 1, 2 or 4 probes, then fipmaps of so many accesses.
const int AUTO_CHAINED = 3;
const float AUTO_ACCESSES[5] = float[5](4.0, 6.0, 8.0, 12.0, 16.0);

// Place of a footprint along a logarithmic axis of the table, from 0; a footprint that is not a number is the last one.
int auto_place(float size, float first, int count)
{
    float place = floor(2.0 * log2(max(size, 1e-30)) + 0.5 - first);  // 1e-30 keeps log2 finite on degenerate ones
    return place < float(count - 1) ? int(max(place, 0.0)) : count - 1;
}

// y down, as the table has it.
int auto_sector(vec2 major)
{
    bool isFlat = abs(major.x) >= abs(major.y);
    float tangent = isFlat ? major.y / (major.x == 0.0 ? 1.0 : major.x) : major.x / major.y;
    int quarter = int(floor(4.0 * tangent + 0.5));
    return (isFlat ? 4 + quarter : 12 - quarter) & (AUTO_SECTORS - 1);
}

// Number of the candidate.
int auto_choice(Image image, vec2 dx, vec2 dy)
{
    Footprint footprint = make_footprint(dx * image.size, dy * image.size);
    int minor = auto_place(footprint.minorAxis, -2.0, AUTO_MINORS);
    int ratio = auto_place(footprint.majorAxis / max(footprint.minorAxis, 1e-30), 0.0, AUTO_RATIOS);
    int sector = auto_sector(vec2(footprint.majorDirection.x, -footprint.majorDirection.y));
    vec4 eight = record_fetch(int(image.table.x) + CHAIN_SLANTS + (sector * AUTO_MINORS + minor) / 2);
    vec2 ratios = (minor & 1) == 0 ? eight.xy : eight.zw;
    return (int(ratio < 8 ? ratios.x : ratios.y) >> (3 * (ratio & 7))) & 7;
}

vec4 filter_auto(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    int choice = auto_choice(image, dx, dy);
    // Each filter ends its loop by its number of probes, so that little is done for one that is not wanted.
    if (choice >= AUTO_CHAINED) {
        LOOKUP_FILTER(3);
        return fipmap_sample(image, uv, dx, dy, AUTO_ACCESSES[choice - AUTO_CHAINED], lod);
    }
    LOOKUP_FILTER(choice == 0 ? 0 : 1);
    return filter_anisotropic(image, uv, dx, dy, float(1 << choice), lod);
}
#endif
