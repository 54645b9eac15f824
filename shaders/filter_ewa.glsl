// The elliptical weighted average: every texel under a Gaussian that the Jacobian makes of a round one of half a pixel.
// Paul Heckbert, "Fundamentals of Texture Mapping and Image Warping", 1989, chapter 3.
// Twin: plugin/fexel/filters/ewa.py. Included by image.glsl. Provides filter_ewa. Units: texels, y as t, upwards.
//
// Taps are not capped: 3400 at an elevation of 0.1 degrees. This is a reference to compare with, not to draw with.

#if defined(IMAGE_LEVELS) && IMAGE_FILTER_EWA

const float EWA_RADIUS = 2.0;          // standard deviations
const float EWA_LEAST_MINOR = 1.5;     // texels that the minor axis spans at least, beyond level 0
const float EWA_MOST_RATIO = 1024.0;   // of the axes; a longer ellipse is as wide as that
const float EWA_LARGEST = 1e9;         // texels per pixel: more is the whole image; squared twice it is a float
const int EWA_MOST_TAPS = 1 << 17;     // ends the loop whatever the data say; more than EWA_MOST_RATIO leaves

struct Ellipse {
    vec2 center;
    float across;     // standard deviation along y
    float slope;      // of the line of means of rows, x over y
    float spread;     // standard deviation along a row
};

// center, size: of a level and in its texels; axes: columns of the Jacobian in texels of level 0, scale: texels of the
// level per texel of level 0; widened: variance added where the ellipse would be too thin.
Ellipse ewa_ellipse(vec2 center, mat2 axes, vec2 scale, float widened)
{
    vec2 first = axes[0] * scale;
    vec2 second = axes[1] * scale;
    // Bilinear in texels of level 0 (variance 1/6), less the box that made the level.
    vec2 extra = (widened + 0.25) * scale * scale - 1.0 / 12.0;
    float xx = 0.25 * (first.x * first.x + second.x * second.x);
    float xy = 0.25 * (first.x * first.y + second.x * second.y);
    float yy = 0.25 * (first.y * first.y + second.y * second.y);
    // Not xx yy - xy xy, which loses the short axis beside the long one.
    float area = 0.25 * (first.x * second.y - first.y * second.x);
    float determinant = area * area + extra.y * xx + extra.x * yy + extra.x * extra.y;
    yy += extra.y;
    return Ellipse(center, sqrt(yy), xy / yy, sqrt(determinant / yy));
}

// All texels of one level within the ellipse, row by row in one loop: pixels that run in step need not wait for the
// longest row. taps: how many there were.
vec4 ewa_average(Image image, Ellipse ellipse, int level, out float taps)
{
    vec2 size = image_level_size(image, level);
    float row = ceil(ellipse.center.y - EWA_RADIUS * ellipse.across - 0.5) - 1.0;
    float lastRow = floor(ellipse.center.y + EWA_RADIUS * ellipse.across - 0.5);
    float column = 0.0;
    float lastColumn = 0.0;
    vec4 sum = vec4(0.0);
    float total = 0.0;
    int left = EWA_MOST_TAPS;
    taps = 0.0;
    do {
        bool isNext = column >= lastColumn;
        row = isNext ? row + 1.0 : row;
        float down = row + 0.5 - ellipse.center.y;
        float height = down / ellipse.across;
        float mean = ellipse.center.x + ellipse.slope * down;
        float halfRow = ellipse.spread * sqrt(max(EWA_RADIUS * EWA_RADIUS - height * height, 0.0));
        column = isNext ? ceil(mean - halfRow - 0.5) : column + 1.0;
        lastColumn = floor(mean + halfRow - 0.5);
        float along = (column + 0.5 - mean) / ellipse.spread;
        // Past the last row nothing counts, so that one round too many changes nothing.
        float counts = row <= lastRow && column <= lastColumn ? 1.0 : 0.0;
        float weight = counts * exp(-0.5 * (along * along + height * height));
        sum += weight * image_at_level(image, (vec2(column, row) + 0.5) / size, float(level));
        total += weight;
        taps += counts;
        left--;
    } while (row <= lastRow && left > 0);
    return sum / total;
}

// Whole periods of a place, whose digits are better spent within one.
vec2 ewa_period(Image image, vec2 uv)
{
    ivec2 modes = ivec2(image.codes >> 10, image.codes >> 12) & 3;
    vec2 mirrored = vec2(equal(modes, ivec2(WRAP_MIRROR)));
    vec2 cyclic = vec2(equal(modes, ivec2(WRAP_REPEAT))) + mirrored;
    vec2 period = 1.0 + mirrored;
    return cyclic * period * floor(uv / period);
}

vec4 filter_ewa(Image image, vec2 uv, vec2 dx, vec2 dy, float maxProbes, out float lod)
{
    int finest = image.codes & 15;
    int coarsest = (image.codes >> 4) & 15;
    mat2 axes = mat2(dx * image.size, dy * image.size) * exp2(-image.bias);
    vec4 reach = abs(vec4(axes[0], axes[1]));
    axes = reach.x + reach.y + reach.z + reach.w < EWA_LARGEST ? axes : mat2(EWA_LARGEST);
    Footprint footprint = make_footprint(axes[0], axes[1]);
    float minor = max(footprint.minorAxis, footprint.majorAxis / EWA_MOST_RATIO);
    lod = log2(max(minor, 1e-30));  // 1e-30 keeps log2 finite on a degenerate footprint
    float wanted = lod - log2(EWA_LEAST_MINOR);
    int level = int(clamp(floor(wanted), float(finest), float(coarsest)));
    // A footprint of more than the image is one of the coarsest level, which is constant but for its border; where fine
    // levels are not resident, the ellipse is as wide as the finest one asks for.
    float shrink = exp2(min(float(coarsest + 1) - wanted, 0.0));
    float width = max(minor * shrink, level > 0 ? EWA_LEAST_MINOR * exp2(float(level)) : 0.0);
    float widened = 0.25 * max(width * width - footprint.minorAxis * footprint.minorAxis * shrink * shrink, 0.0);
    vec2 whole = ewa_period(image, uv);
    vec2 size = image_level_size(image, level);
    float taps;
    Ellipse ellipse = ewa_ellipse((uv - whole) * size, axes * shrink, size / image.size, widened);
    vec4 average = ewa_average(image, ellipse, level, taps);
    // Where texels are larger than a pixel, a Gaussian is not what lies between their centres.
    float magnified = clamp(2.0 - 2.0 * footprint.majorAxis, 0.0, 1.0);
    LOOKUP_COUNT(taps + (magnified > 0.0 ? 4.0 : 0.0));
    return mix(average, image_at_level(image, uv, float(finest)), magnified);
}
#endif
