// An image looked up at given places with given derivatives, one per pixel: for tests and measurements.
#include "image.glsl"
uniform sampler2D lookupSt;          // xy: [0, 1]^2 of the image, t up
uniform sampler2D lookupJacobian;    // xy: derivative per pixel along x, zw: along y
uniform int imageRecord;
uniform float imageMaxProbes;

layout(location = 0) out vec4 out_color;
layout(location = 1) out vec4 out_lookup;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 jacobian = texelFetch(lookupJacobian, pixel, 0);
    float lod;
    out_color = image_sample(imageRecord, texelFetch(lookupSt, pixel, 0).xy, jacobian.xy, jacobian.zw, imageMaxProbes, lod);
#if LOOKUP_COUNTS
    out_lookup = vec4(lod, lookupFetches, lookupFilter, 1.0);
#else
    out_lookup = vec4(lod, 0.0, -1.0, 1.0);
#endif
}
