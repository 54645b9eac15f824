// A texture alone, unlit: linear, premultiplied rgba, then (mip level, layer). Used to bake and to measure textures.
// Defines: TEXTURE_SAMPLE, the kind's sampling function, whose file is among the includes; TEXTURE_NUMBER, which of the
// textures of its kind in the binding, 0 unless given.
#ifndef TEXTURE_NUMBER
#define TEXTURE_NUMBER 0
#endif

in vec2 st;

layout(location = 0) out vec4 out_color;
#if TEXTURE_AOVS
layout(location = 1) out vec4 out_lookup;
#endif

void main()
{
    float lod;
    float patchIndex;
    out_color = TEXTURE_SAMPLE(TEXTURE_NUMBER, st, dFdx(st), dFdy(st), lod, patchIndex);
#if TEXTURE_AOVS
    out_lookup = vec4(lod, patchIndex, 0.0, 1.0);
#endif
}
