// Inputs of UsdPreviewSurface: for each a uniform, or with <INPUT>_TEXTURE the texel of a slot.
// Requires surface_textures; uniforms named as the inputs. Provides one function per input.

#ifdef DIFFUSECOLOR_TEXTURE
vec3 input_diffuse_color() { return texel_color(texels[DIFFUSECOLOR_TEXTURE], DIFFUSECOLOR_OUTPUT); }
#elif defined(DISPLAY_COLOR)
in vec3 displayColor;
vec3 input_diffuse_color() { return displayColor; }
#else
uniform vec3 diffuseColor;
vec3 input_diffuse_color() { return diffuseColor; }
#endif

#ifdef EMISSIVECOLOR_TEXTURE
vec3 input_emissive_color() { return texel_color(texels[EMISSIVECOLOR_TEXTURE], EMISSIVECOLOR_OUTPUT); }
#else
uniform vec3 emissiveColor;
vec3 input_emissive_color() { return emissiveColor; }
#endif

#ifdef SPECULARCOLOR_TEXTURE
vec3 input_specular_color() { return texel_color(texels[SPECULARCOLOR_TEXTURE], SPECULARCOLOR_OUTPUT); }
#else
uniform vec3 specularColor;
vec3 input_specular_color() { return specularColor; }
#endif

#ifdef METALLIC_TEXTURE
float input_metallic() { return texel_value(texels[METALLIC_TEXTURE], METALLIC_OUTPUT); }
#else
uniform float metallic;
float input_metallic() { return metallic; }
#endif

#ifdef ROUGHNESS_TEXTURE
float input_roughness() { return texel_value(texels[ROUGHNESS_TEXTURE], ROUGHNESS_OUTPUT); }
#else
uniform float roughness;
float input_roughness() { return roughness; }
#endif

#ifdef CLEARCOAT_TEXTURE
float input_clearcoat() { return texel_value(texels[CLEARCOAT_TEXTURE], CLEARCOAT_OUTPUT); }
#else
uniform float clearcoat;
float input_clearcoat() { return clearcoat; }
#endif

#ifdef CLEARCOATROUGHNESS_TEXTURE
float input_clearcoat_roughness()
{
    return texel_value(texels[CLEARCOATROUGHNESS_TEXTURE], CLEARCOATROUGHNESS_OUTPUT);
}
#else
uniform float clearcoatRoughness;
float input_clearcoat_roughness() { return clearcoatRoughness; }
#endif

#ifdef OPACITY_TEXTURE
float input_opacity() { return texel_value(texels[OPACITY_TEXTURE], OPACITY_OUTPUT); }
#elif defined(DISPLAY_OPACITY)
in float displayOpacity;
float input_opacity() { return displayOpacity; }
#else
uniform float opacity;
float input_opacity() { return opacity; }
#endif

#ifdef OPACITYTHRESHOLD_TEXTURE
float input_opacity_threshold() { return texel_value(texels[OPACITYTHRESHOLD_TEXTURE], OPACITYTHRESHOLD_OUTPUT); }
#else
uniform float opacityThreshold;
float input_opacity_threshold() { return opacityThreshold; }
#endif

#ifdef IOR_TEXTURE
float input_ior() { return texel_value(texels[IOR_TEXTURE], IOR_OUTPUT); }
#else
uniform float ior;
float input_ior() { return ior; }
#endif

#ifdef OCCLUSION_TEXTURE
float input_occlusion() { return texel_value(texels[OCCLUSION_TEXTURE], OCCLUSION_OUTPUT); }
#else
uniform float occlusion;
float input_occlusion() { return occlusion; }
#endif

#ifdef NORMAL_TEXTURE
vec3 input_normal() { return texel_color(texels[NORMAL_TEXTURE], NORMAL_OUTPUT); }
#endif
