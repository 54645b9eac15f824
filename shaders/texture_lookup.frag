// A texture looked up at given places with given derivatives, one per pixel: for tests. Edges of pinchmaps that go the fast
// way are anti-aliased by differences between pixels, whose places must then be neighbours.
// Defines: TEXTURE_SAMPLE, the kind's sampling function, whose file is among the includes.
uniform sampler2D lookupSt;          // xy: local texture coordinates
uniform sampler2D lookupJacobian;    // xy: derivative per pixel along x, zw: along y

layout(location = 0) out vec4 out_color;
layout(location = 1) out vec4 out_lookup;

void main()
{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 st = texelFetch(lookupSt, pixel, 0).xy;
    vec4 jacobian = texelFetch(lookupJacobian, pixel, 0);
    float lod;
    float patchIndex;
    out_color = TEXTURE_SAMPLE(0, st, jacobian.xy, jacobian.zw, lod, patchIndex);
    out_lookup = vec4(lod, patchIndex, 0.0, 1.0);
}
