// Distant and sphere lights of UsdLux, and the camera's headlight, as cones of constant radiance.
// Requires common_math, surface_brdf; LIGHT_COUNT. Provides analytic_lights. No shadows.

#define LIGHT_DISTANT 0.0
#define LIGHT_SPHERE 1.0
#define LIGHT_CAMERA 2.0

#if LIGHT_COUNT > 0
uniform vec4 lightPosition[LIGHT_COUNT];   // distant: direction towards it; sphere: centre around the camera; w: which
uniform vec4 lightPower[LIGHT_COUNT];      // rgb: irradiance facing it (distant, camera), times distance squared (sphere)
                                           // w: sine of half the angle (distant), radius (sphere)
uniform vec2 lightShare[LIGHT_COUNT];      // diffuse and specular multipliers
#endif

struct Cone { vec3 axis; float sinAngle; vec3 irradiance; };   // irradiance of a surface that faces it

// Part of the irradiance that reaches a surface at cosine `cosine` from the axis of a cone of sine `sinAngle`, partly
// below the horizon too. Lagarde and de Rousiers, "Moving Frostbite to Physically Based Rendering", 2014, listing 7.
float cone_form_factor(float cosine, float sinAngle)
{
    float sin2 = sinAngle * sinAngle;
    if (cosine >= sinAngle || sin2 < 1e-8)     // 1e-8: a cone that narrow is a ray
        return saturate(cosine);
    if (cosine <= -sinAngle)
        return 0.0;
    float sine = sqrt(max(1.0 - cosine * cosine, 1e-12));
    float x = sqrt(max(1.0 / sin2 - 1.0, 0.0));
    float y = clamp(-x * (cosine / sine), -1.0, 1.0);
    float z = sine * sqrt(1.0 - y * y);
    float factor = (cosine * acos(y) - x * z) * sin2 + atan(z, max(x, 1e-7));
    return max(factor * INV_PI / sin2, 0.0);
}

// Direction within the cone nearest to the mirror direction. Karis, "Real Shading in Unreal Engine 4", 2013.
vec3 representative_direction(Cone cone, vec3 mirror)
{
    float cosine = dot(mirror, cone.axis);
    float cosAngle = sqrt(max(1.0 - cone.sinAngle * cone.sinAngle, 0.0));
    if (cosine >= cosAngle)
        return mirror;
    vec3 aside = safe_normalize(mirror - cosine * cone.axis, vec3(0.0));
    return cone.axis * cosAngle + aside * cone.sinAngle;
}

#if LIGHT_COUNT > 0
Cone light_cone(int i, vec3 position, vec3 view)
{
    vec4 place = lightPosition[i];
    vec4 power = lightPower[i];
    if (place.w == LIGHT_DISTANT)
        return Cone(place.xyz, power.w, power.rgb);
    if (place.w == LIGHT_CAMERA)
        return Cone(view, 0.0, power.rgb);
    vec3 towards = place.xyz - position;
    // Inside the light its radiance comes from all of the hemisphere; 1e-18 guards a light without extent.
    float distanceSquared = max(dot(towards, towards), max(power.w * power.w, 1e-18));
    float distanceToCentre = sqrt(distanceSquared);
    return Cone(safe_normalize(towards, view), min(power.w / distanceToCentre, 1.0), power.rgb / distanceSquared);
}
#endif

vec3 analytic_lights(Surface s, vec3 position)
{
    vec3 radiance = vec3(0.0);
#if LIGHT_COUNT > 0
    vec3 mirror = reflect(-s.view, s.normal);
    for (int i = 0; i < LIGHT_COUNT; ++i)
    {
        Cone cone = light_cone(i, position, s.view);
        float cosine = dot(s.normal, cone.axis);
        vec3 diffuse = s.baseWeight * s.diffuse * INV_PI * cone_form_factor(cosine, cone.sinAngle);
        vec3 specular = surface_specular(s, representative_direction(cone, mirror), 0.5 * cone.sinAngle);
        radiance += cone.irradiance * (diffuse * lightShare[i].x + specular * lightShare[i].y);
    }
#endif
    return radiance;
}
