// What is done to the filtered colour of a texture: vectors are renormalised, so that a bumpy surface does not turn
// dark far away; contrast and brightness (Bornik and Ferko 2002, eq. 1: s and o); its fade with distance, as haze does.
// Requires TEXTURE_COUNT; eyePosition and viewDirection of mesh.frag. Provides camera_distance, texture_remains,
// adjust_texel.
//
// Defines: TEXTURE_RENORMALISED, TEXTURE_TONED, TEXTURE_ATTENUATED: bit i for slot i; none is there where no texture
// asks for it.

#if defined(TEXTURE_RENORMALISED) || defined(TEXTURE_TONED) || defined(TEXTURE_ATTENUATED)
#define TEXTURE_ADJUSTED 1
uniform vec4 textureTone[TEXTURE_COUNT];     // contrast s, brightness o, 1 / attenuationDistance
uniform vec4 textureHaze[TEXTURE_COUNT];     // attenuationColor
#else
#define TEXTURE_ADJUSTED 0
#endif
#ifndef TEXTURE_RENORMALISED
#define TEXTURE_RENORMALISED 0
#endif
#ifndef TEXTURE_TONED
#define TEXTURE_TONED 0
#endif
#ifndef TEXTURE_ATTENUATED
#define TEXTURE_ATTENUATED 0
#endif

#if TEXTURE_ADJUSTED
// From the camera to a point, of an orthographic camera to its plane: scene units, >= 0.
float camera_distance(vec3 position)
{
    return viewDirection.w > 0.5 ? length(position) : max(-dot(viewDirection.xyz, position), 0.0);
}

// What is left of the texture of a slot, in [0, 1].
float texture_remains(int slot)
{
    return exp(-camera_distance(eyePosition) * textureTone[slot].z);
}

// A vector, times alpha, made as long as alpha; one that cancels out has no direction: it stays as it is.
vec3 unit_vector(vec4 texel)
{
    float size = length(texel.rgb);
    return size > 1e-4 * abs(texel.a) ? texel.rgb * (abs(texel.a) / size) : texel.rgb;
}

// texel: linear, premultiplied; alpha stays as it is. slot is known when compiled, so that no branch is left.
vec4 adjust_texel(int slot, vec4 texel)
{
    vec3 color = texel.rgb;
    if (((TEXTURE_RENORMALISED >> slot) & 1) != 0)
        color = unit_vector(texel);
    if (((TEXTURE_TONED >> slot) & 1) != 0)
        color = textureTone[slot].x * color + textureTone[slot].y * texel.a;
    if (((TEXTURE_ATTENUATED >> slot) & 1) != 0)
        color = mix(texel.a * textureHaze[slot].rgb, color, texture_remains(slot));
    return vec4(color, texel.a);
}
#endif
