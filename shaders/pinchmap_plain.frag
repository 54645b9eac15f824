// A pinchmapped texture with two samplers of its own, seen from the front: what the pinch costs, and how exact it is.
// Defines: PINCHMAP_EXACT 1 for four texelFetches, 0 for one bilinear access; PINCHMAP_LINES; PINCHMAP_MAGNIFIED 1 where
// no pixel covers more than a signal texel.
#include "common_footprint.glsl"
#include "pinchmap_warp.glsl"
uniform sampler2D pinchmap;      // with a margin of one texel at s = 1 and t = 1
uniform sampler2D signal;
uniform vec2 pinchmapSize;       // texels, without the margin
uniform vec2 origin;             // position of uv = (0, 0), in texels from `cell`
uniform mat2 axes;               // columns: d(position)/d(uv)
uniform vec2 cell;               // whole texels: keeps a close view exact
uniform float halfTexel;
uniform float antialias;
uniform float lineWidth;
uniform vec4 lineColor;          // straight alpha

in vec2 uv;

layout(location = 0) out vec4 out_color;

void main()
{
    vec2 position = origin + axes * uv;
    vec2 dx = dFdx(position);
    vec2 dy = dFdy(position);
    vec2 free = position;
    position = clamp(position, -cell, pinchmapSize - cell);
#if PINCHMAP_EXACT
    vec2 corner = min(floor(position), pinchmapSize - cell - 1.0);
    ivec2 lowest = ivec2(corner + cell);
    vec2 inside = vec2(equal(position, free));       // clamped, it does not change along the axis
    vec2 gradient;
    vec4 texel = pinch_bilinear(texelFetch(pinchmap, lowest, 0), texelFetch(pinchmap, lowest + ivec2(1, 0), 0),
                                texelFetch(pinchmap, lowest + ivec2(0, 1), 0),
                                texelFetch(pinchmap, lowest + ivec2(1, 1), 0), position - corner, inside * dx,
                                inside * dy, gradient);
#else
    vec4 texel = textureLod(pinchmap, (position + cell + 0.5) / (pinchmapSize + 1.0), 0.0);
    float edge = pinch_edge(texel);
    vec2 gradient = vec2(dFdx(edge), dFdy(edge));
#endif
#if PINCHMAP_MAGNIFIED
    float footprint = 0.0;
    float level = 0.0;
#else
    float width = isotropic_level(dx, dy);
    float footprint = exp2(width);
    float level = width - log2(2.0 * halfTexel);
#endif
    vec2 offset = pinch_displace(texel, position, gradient, halfTexel, antialias, footprint);
    vec4 color = textureLod(signal, (position + cell + offset) / pinchmapSize, level);
#if PINCHMAP_LINES
    float cover = lineColor.a * pinch_line(texel, position, gradient, dx, dy, lineWidth, antialias, footprint);
    color = mix(color, vec4(lineColor.rgb, 1.0), cover);
#endif
    out_color = color;
}
