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
//   line = pinch_line(texel, gradient, dx, dy, lineWidth, antialias); // coverage of the solid line, over the color
// or, inside a loop and where a texel is so large that 8-bit filter weights or float32 texture coordinates would show,
//   vec4 texel = pinch_bilinear(t00, t10, t01, t11, position - floor(position), dx, dy, gradient);
// from four texelFetches, whose gradient is exact. dx, dy: derivative of position per pixel.

// What changes sign at the discontinuity: positive on the side of k = +1. Linear in the texels.
float pinch_edge(vec4 texel)
{
    return texel.z - texel.w;
}

// Bilinear interpolation by hand, and the derivative of pinch_edge per pixel along x and y.
// t00 lower left, t10 lower right, t01 upper left, t11 upper right; fraction: position within them.
vec4 pinch_bilinear(vec4 t00, vec4 t10, vec4 t01, vec4 t11, vec2 fraction, vec2 dx, vec2 dy, out vec2 gradient)
{
    vec4 across = t10 - t00;
    vec4 twist = t11 - t01 - across;
    vec4 ds = across + fraction.y * twist;
    vec4 dt = t01 - t00 + fraction.x * twist;
    vec2 slope = vec2(pinch_edge(ds), pinch_edge(dt));
    gradient = vec2(dot(slope, dx), dot(slope, dy));
    return t00 + fraction.x * across + fraction.y * dt;
}

// Displacement, in pinchmap texels.
// gradient: of pinch_edge per pixel; h: half a signal texel, 2^(-K-1); antialias: width of the transition in pixels, 0 for a
// hard edge; footprint: the longest axis of the pixel.
vec2 pinch_displace(vec4 texel, vec2 position, vec2 gradient, float h, float antialias, float footprint)
{
    vec2 d = mix(vec2(0.0), texel.xy, greaterThan(abs(texel.xy), vec2(1e-5)));  // a decoded 127 may miss 0 by a rounding
    float kB = texel.z;
    // Rectified k (5.1): linear along the segment through this place, the alternative nearer to kB.
    vec2 alternative = 0.5 * sign(kB) - sign(d) * (fract(position) - 0.5);
    float nearer = abs(alternative.x - kB) < abs(alternative.y - kB) ? alternative.x : alternative.y;
    float k = d.x * d.y != 0.0 && kB != 0.0 ? nearer : kB;
    float gamma = texel.w + (k - kB);
    float edge = k - gamma;
    float side = edge > 0.0 ? 1.0 : -1.0;
    // m falls from 1 at the line to 0 at the end of the segment.
    float m = (1.0 - side * k) / max(1.0 - side * gamma, 1e-6);
    float pinched = 1.0 - (1.0 - h) * m;
    float ramp = 2.0 * h * abs(edge) * inversesqrt(max(antialias * antialias * dot(gradient, gradient), 1e-20));
    float target = side * clamp(ramp, 1.0 - m, pinched);
    vec2 direction = clamp(d / (1.0 - max(abs(k), abs(kB)) + 1e-6), -1.0, 1.0);
    float fade = clamp(2.0 - footprint, 0.0, 1.0);
    return fade * (k - target) * direction;
}

// Coverage of a solid line of lineWidth pinchmap texels along the discontinuity, 0 to 1.
float pinch_line(vec4 texel, vec2 gradient, vec2 dx, vec2 dy, float lineWidth, float antialias)
{
    return 0.0;
}
