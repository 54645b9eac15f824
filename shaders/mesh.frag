// A fragment of a mesh: UsdPreviewSurface under the stage's lights, or with DATA_AOVS its data AOVs.
// Colour is linear Rec.709, premultiplied. Everything that takes derivatives happens before any branch or discard.
#include "common_math.glsl"
#include "common_latlong.glsl"

in vec3 eyePosition;
in vec3 worldNormal;
#if ST_COUNT > 0
in vec2 st0;
#endif
#if ST_COUNT > 1
in vec2 st1;
#endif
#if ST_COUNT > 2
in vec2 st2;
#endif
#if ST_COUNT > 3
in vec2 st3;
#endif

uniform vec4 viewDirection;      // w = 1: perspective; w = 0: xyz points towards an orthographic camera
uniform float largestValue;      // of the target's format; a brighter pixel is clamped, never infinite

#include "surface_textures.glsl"
#include "surface_inputs.glsl"
#include "surface_normal.glsl"
#include "surface_brdf.glsl"
#include "light_analytic.glsl"
#include "light_dome.glsl"
#include "decision.glsl"
#include "mesh_aovs.glsl"

// How much of the surface is there: cut out (CUTOUT), blended (TRANSLUCENT) or all of it.
float surface_presence()
{
#if defined(CUTOUT)
    if (input_opacity() < input_opacity_threshold())
        discard;
    return 1.0;
#elif defined(TRANSLUCENT)
    return saturate(input_opacity());
#else
    return 1.0;
#endif
}

vec3 surface_radiance(vec3 normal, vec3 view, float presence)
{
    vec3 radiance = input_emissive_color() * presence;
#ifdef LIT
    Surface s = make_surface(normal, view, presence);
    radiance += analytic_lights(s, eyePosition) + dome_light(s, saturate(input_occlusion()));
#endif
    return radiance;
}

#ifndef DATA_AOVS
out vec4 outColor;
#endif

void main()
{
    sample_textures();
    vec3 normal = shading_normal(worldNormal, eyePosition, gl_FrontFacing);
#ifdef DATA_AOVS
    measure_aovs(eyePosition);
#endif
    float presence = surface_presence();
#ifdef DATA_AOVS
    if (presence <= 0.0)
        discard;
    write_aovs(normal, eyePosition);
#else
    vec3 view = viewDirection.w > 0.5 ? safe_normalize(-eyePosition, normal) : viewDirection.xyz;
    vec3 radiance = surface_radiance(normal, view, presence);
    outColor = vec4(clamp(radiance, -largestValue, largestValue), presence);
#endif
}
