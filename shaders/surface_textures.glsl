// The material's textures, each sampled once whatever inputs it drives.
// Requires TEXTURE_COUNT and, per slot i, TEXTUREi_SAMPLE (the kind's function), TEXTUREi_NUMBER (which of the textures of
// its kind) and TEXTUREi_ST (its varying).
// Provides texels (linear, premultiplied), sample_textures, texel_color, texel_value; lod and patch of MAIN_TEXTURE, which
// is slot 0, and with LOOKUP_COUNTS what its lookup takes: textureFetches, textureFilter.
#include "texture_adjust.glsl"
#include "lookup_counts.glsl"

#if TEXTURE_COUNT > 0
vec4 texels[TEXTURE_COUNT];
#endif
float textureLod0 = -1.0;       // -1: no texture
float texturePatch = -1.0;

#if LOOKUP_COUNTS
uniform float mainFilter;       // of the main texture, unless its lookup tells another one
float textureFetches = 0.0;
float textureFilter = -1.0;     // -1: no texture
#endif

#if TEXTURE_ADJUSTED
#define ADJUST_SLOT(slot) texels[slot] = adjust_texel(slot, texels[slot]);
#else
#define ADJUST_SLOT(slot)
#endif

#define SAMPLE_SLOT(slot, number, sampleFunction, st)                                     \
    {                                                                                     \
        float lod;                                                                        \
        float patchIndex;                                                                 \
        texels[slot] = sampleFunction(number, st, dFdx(st), dFdy(st), lod, patchIndex);   \
        if (slot == MAIN_TEXTURE) { textureLod0 = lod; texturePatch = patchIndex; }       \
        ADJUST_SLOT(slot)                                                                 \
    }

// Outside any branch, since it takes derivatives.
void sample_textures()
{
#if TEXTURE_COUNT > 0 && LOOKUP_COUNTS
    lookupFetches = 0.0;
    lookupFilter = mainFilter;
#endif
#if TEXTURE_COUNT > 0
    SAMPLE_SLOT(0, TEXTURE0_NUMBER, TEXTURE0_SAMPLE, TEXTURE0_ST)
#endif
#if TEXTURE_COUNT > 0 && LOOKUP_COUNTS
    textureFetches = lookupFetches;
    textureFilter = lookupFilter;
#endif
#if TEXTURE_COUNT > 1
    SAMPLE_SLOT(1, TEXTURE1_NUMBER, TEXTURE1_SAMPLE, TEXTURE1_ST)
#endif
#if TEXTURE_COUNT > 2
    SAMPLE_SLOT(2, TEXTURE2_NUMBER, TEXTURE2_SAMPLE, TEXTURE2_ST)
#endif
#if TEXTURE_COUNT > 3
    SAMPLE_SLOT(3, TEXTURE3_NUMBER, TEXTURE3_SAMPLE, TEXTURE3_ST)
#endif
#if TEXTURE_COUNT > 4
    SAMPLE_SLOT(4, TEXTURE4_NUMBER, TEXTURE4_SAMPLE, TEXTURE4_ST)
#endif
#if TEXTURE_COUNT > 5
    SAMPLE_SLOT(5, TEXTURE5_NUMBER, TEXTURE5_SAMPLE, TEXTURE5_ST)
#endif
#if TEXTURE_COUNT > 6
    SAMPLE_SLOT(6, TEXTURE6_NUMBER, TEXTURE6_SAMPLE, TEXTURE6_ST)
#endif
#if TEXTURE_COUNT > 7
    SAMPLE_SLOT(7, TEXTURE7_NUMBER, TEXTURE7_SAMPLE, TEXTURE7_ST)
#endif
}

// Outputs of a texture prim: rgb, r, g, b (straight, as UsdUVTexture gives them) and a.
#define OUTPUT_RGB 0
#define OUTPUT_A 4

vec3 texel_color(vec4 texel, int outputName)
{
    if (outputName == OUTPUT_A)
        return vec3(texel.a);
    vec3 straight = texel.a > 0.0 ? texel.rgb / texel.a : vec3(0.0);
    return outputName == OUTPUT_RGB ? straight : vec3(straight[outputName - 1]);
}

float texel_value(vec4 texel, int outputName)
{
    return texel_color(texel, outputName).x;
}
