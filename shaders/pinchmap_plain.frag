// A pinchmapped texture with two samplers of its own: what the pinch costs, and how exact it is.
// Defines: PINCHMAP_EXACT 1 for four texelFetches, 0 for one bilinear access; PINCHMAP_LINES; PINCHMAP_MAGNIFIED 1 where
// no pixel covers more than a signal texel.
#include "common_footprint.glsl"
#include "pinchmap_warp.glsl"
uniform sampler2D pinchmap;      // with the row and column at s = 1 and t = 1
uniform sampler2D signal;
uniform vec2 pinchmapSize;       // texels, without these
uniform vec2 pinchmapScale;      // 1 / (size with these)
uniform float halfTexel;
uniform float antialias;
uniform float lineWidth;
uniform vec4 lineColor;          // straight alpha

in vec2 st;

layout(location = 0) out vec4 out_color;

void main()
{
    vec2 position = st * pinchmapSize;
    vec2 dx = dFdx(position);
    vec2 dy = dFdy(position);
#if PINCHMAP_EXACT
    vec2 corner = min(floor(position), pinchmapSize - 1.0);
    ivec2 texelIndex = ivec2(corner);
    vec2 gradient;
    vec4 texel = pinch_bilinear(texelFetch(pinchmap, texelIndex, 0), texelFetch(pinchmap, texelIndex + ivec2(1, 0), 0),
                                texelFetch(pinchmap, texelIndex + ivec2(0, 1), 0),
                                texelFetch(pinchmap, texelIndex + ivec2(1, 1), 0), position - corner, dx, dy, gradient);
#else
    vec4 texel = textureLod(pinchmap, (position + 0.5) * pinchmapScale, 0.0);
    float edge = pinch_edge(texel);
    vec2 gradient = vec2(dFdx(edge), dFdy(edge));
#endif
#if PINCHMAP_MAGNIFIED
    float footprint = 0.0;
    vec2 offset = pinch_displace(texel, position, gradient, halfTexel, antialias, footprint);
    vec4 color = textureLod(signal, st + offset / pinchmapSize, 0.0);
#else
    float level = isotropic_level(dx, dy);
    float footprint = exp2(level);
    vec2 offset = pinch_displace(texel, position, gradient, halfTexel, antialias, footprint);
    vec4 color = textureLod(signal, st + offset / pinchmapSize, level - log2(2.0 * halfTexel));
#endif
#if PINCHMAP_LINES
    float cover = lineColor.a * pinch_line(texel, position, gradient, dx, dy, lineWidth, antialias, footprint);
    color = mix(color, vec4(lineColor.rgb, 1.0), cover);
#endif
    out_color = color;
}
