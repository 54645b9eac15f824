// The pinch: where to look a discontinuous texture up in its signal (Tarini and Cignoni 2005, sections 4 to 6).
// Provides pinch_edge, pinch_bilinear, pinch_displace, pinch_line. No samplers, no uniforms, no derivatives taken.
//
// A pinchmap texel is (d_s, d_t, k, gamma), decoded to [-1, 1]; d points to the side of k = -1 and is as long (infinity
// norm) as the discontinuity is strong. Lengths are in pinchmap texels. A sampling function does, with st wrapped:
//   vec2 position = st * size;                                        // size of the pinchmap; texel j lies at position j
//   vec4 texel = texture(pinchmap, (position + 0.5) / size);           // one bilinear access
//   vec2 gradient = vec2(dFdx(pinch_edge(texel)), dFdy(pinch_edge(texel)));      // in uniform control flow only
//   vec2 offset = pinch_displace(texel, position, gradient, h, antialias, footprint);
//   color = textureGrad(signal, st + offset / size, dstdx, dstdy);    // mip level of the undisplaced st
//   line = pinch_line(texel, position, gradient, dx, dy, lineWidth, antialias, footprint); // coverage, over the color
// or, inside a loop and where a texel is so large that 8-bit filter weights or float32 texture coordinates would show,
//   vec4 texel = pinch_bilinear(t00, t10, t01, t11, position - floor(position), dx, dy, gradient);
// from four texelFetches, whose gradient is exact. dx, dy: derivative of position per pixel.
// fexel/textures/pinchmap_twin.py is the same in float64 and explains the formulas.

// What changes sign at the discontinuity: positive on the side of k = +1. Linear in the texels.
float pinch_edge(vec4 texel)
{
    return texel.z - texel.w;
}

// Bilinear interpolation by hand, and the derivative of pinch_edge per pixel along x and y.
// t00 lower left, t10 lower right, t01 upper left, t11 upper right; fraction: position within them.
vec4 pinch_bilinear(vec4 t00, vec4 t10, vec4 t01, vec4 t11, vec2 fraction, vec2 dx, vec2 dy, out vec2 gradient)
{
    vec4 low = t00 + fraction.x * (t10 - t00);
    vec4 high = t01 + fraction.x * (t11 - t01);
    vec4 up = high - low;
    float across = pinch_edge(t10) - pinch_edge(t00);
    float acrossHigh = pinch_edge(t11) - pinch_edge(t01);
    vec2 slope = vec2(across + fraction.y * (acrossHigh - across), pinch_edge(up));
    gradient = vec2(dot(slope, dx), dot(slope, dy));
    return low + fraction.y * up;
}

// Part of the displacement that is left when a pixel of this footprint covers whole texels: the mip levels show the rest.
float pinch_fade(float footprint)
{
    return clamp(2.0 - footprint, 0.0, 1.0);
}

// |k|, linear along the segment through this place (5.1): of two alternatives the one nearer to the interpolated |k|.
// d and k are interpolated, k >= 0 after a sign is taken out of both. The threshold is for places where d or k is a zero
// with rounding errors, where the alternatives mean nothing.
float pinch_rectify(vec2 d, float kB, vec2 position)
{
    float magnitude = abs(kB);
    vec2 fraction = fract(position);
    float s = d.x * kB > 0.0 ? 1.0 - fraction.x : fraction.x;
    float t = d.y * kB > 0.0 ? 1.0 - fraction.y : fraction.y;
    float nearer = abs(s - magnitude) < abs(t - magnitude) ? s : t;
    return min(abs(d.x), abs(d.y)) * magnitude > 1e-6 ? nearer : magnitude;
}

// The interpolated direction, normalised but for its strength (5.1, 6.2). k: rectified.
vec2 pinch_direction(vec2 d, float k, float kB)
{
    // 1e-6 is for the end of a segment, where d vanishes with the divisor.
    return clamp(d / max(1.0 - max(k, abs(kB)), 1e-6), -1.0, 1.0);
}

// Displacement, in pinchmap texels.
// gradient: of pinch_edge per pixel; h: half a signal texel, 2^(-K-1); antialias: width of the transition in pixels, 0 for a
// hard edge; footprint: the longest axis of the pixel.
vec2 pinch_displace(vec4 texel, vec2 position, vec2 gradient, float h, float antialias, float footprint)
{
    float k = pinch_rectify(texel.xy, texel.z, position);
    float edge = pinch_edge(texel);
    float away = abs(edge);
    float side = edge > 0.0 ? 1.0 : -1.0;
    float rest = 1.0 - side * (texel.z < 0.0 ? -k : k);    // from here to the end of the segment
    float scale = 1.0 / max(rest + away, 1e-6);            // 1e-6 is for a line at the very end
    float seen = clamp(0.5 * footprint, h, 0.5);
    float slope = 2.0 * seen * inversesqrt(max(antialias * antialias * dot(gradient, gradient), 1e-20));
    // 1e-9 gives a hard edge a side where k is gamma exactly, as it is along lines on the lattice.
    float target = clamp(max(away, 1e-9) * slope, away * scale, (away + seen * rest) * scale);
    float moved = pinch_fade(footprint) * side * (1.0 - rest - target);
    return moved * pinch_direction(texel.xy, k, texel.z);
}

// Coverage of a solid line along the discontinuity, lineWidth pinchmap texels wide, 0 to 1.
// dx, dy: derivative of position per pixel.
float pinch_line(vec4 texel, vec2 position, vec2 gradient, vec2 dx, vec2 dy, float lineWidth, float antialias, float footprint)
{
    float determinant = dx.x * dy.y - dx.y * dy.x;
    vec2 slope = vec2(dy.y * gradient.x - dx.y * gradient.y, dx.x * gradient.y - dy.x * gradient.x);
    float halfWidth = 0.5 * lineWidth * length(slope) / max(abs(determinant), 1e-30);   // in units of pinch_edge, as below
    float pixels = 1.0 / max(antialias * length(gradient), 1e-10);
    float away = abs(pinch_edge(texel));
    float covered = clamp(0.5 + (halfWidth - away) * pixels, 0.0, 1.0) - clamp(0.5 - (halfWidth + away) * pixels, 0.0, 1.0);
    vec2 direction = abs(pinch_direction(texel.xy, pinch_rectify(texel.xy, texel.z, position), texel.z));
    return covered * max(direction.x, direction.y) * pinch_fade(footprint);
}
