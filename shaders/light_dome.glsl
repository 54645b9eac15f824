// All dome lights of the stage, baked into one environment around the world's origin (renderer/environment.py).
// Requires common_math, common_latlong, surface_brdf; DOME. Provides dome_light. No shadows but `occlusion`.

#ifdef DOME
uniform sampler2D domeIrradiance;    // irradiance over pi
uniform sampler2D domeRadiance;      // level i: radiance seen through a GGX lobe of roughness i / (levels - 1)
uniform float domeLevels;

vec3 dome_reflection(vec3 direction, float roughness)
{
    return textureLod(domeRadiance, latlong_uv(direction), roughness * (domeLevels - 1.0)).rgb;
}
#endif

// Split sum: Karis, "Real Shading in Unreal Engine 4", 2013.
vec3 dome_light(Surface s, float occluded)
{
#ifdef DOME
    vec3 mirror = reflect(-s.view, s.normal);
    vec3 base = s.diffuse * textureLod(domeIrradiance, latlong_uv(s.normal), 0.0).rgb
        + s.specularAlbedo * dome_reflection(mirror, sqrt(s.alpha));
    vec3 coat = s.clearcoatAlbedo * dome_reflection(mirror, sqrt(s.clearcoatAlpha));
    return occluded * (s.baseWeight * base + coat);
#else
    return vec3(0.0);
#endif
}
