// Reflection of UsdPreviewSurface: Lambert, GGX, clearcoat; energy conserving.
// Requires common_math, surface_inputs; the table `brdfAlbedo`. Provides Surface, make_surface, surface_reflect.

struct Surface
{
    vec3 normal;             // world axes, unit
    vec3 view;               // towards the camera, unit
    float nov;               // cosine between them, > 0
    vec3 diffuse;            // Lambertian albedo, what the coats above leave of it
    vec3 f0;                 // reflectance at normal incidence
    float f90;               // and at grazing incidence
    float alpha;             // GGX width
    vec3 specularAlbedo;     // directional albedo of the specular lobe, multiple scattering included
    vec3 compensation;       // of the single-scattering lobe for the energy it loses
    float baseWeight;        // what the clearcoat lets through
    float clearcoat;
    float clearcoatAlpha;
    float clearcoatAlbedo;
};

uniform sampler2D brdfAlbedo;    // over (nov, roughness): directional albedo for f0 = 1, f90 = 0 and for f0 = 0, f90 = 1

// Below this roughness the highlight of a light without area is narrower than float16 can hold.
const float MIN_ROUGHNESS = 0.045;

vec2 albedo_terms(float nov, float roughness)
{
    vec2 size = vec2(textureSize(brdfAlbedo, 0));
    return texture(brdfAlbedo, (vec2(nov, roughness) * (size - 1.0) + 0.5) / size).rg;
}

// Schlick, "An Inexpensive BRDF Model for Physically-based Rendering", 1994.
vec3 fresnel_schlick(vec3 f0, float f90, float voh)
{
    return f0 + (vec3(f90) - f0) * pow5(1.0 - voh);
}

// Walter et al., "Microfacet Models for Refraction through Rough Surfaces", 2007, eq. (33).
float ggx_distribution(float noh, float alpha)
{
    float a2 = alpha * alpha;
    float d = (noh * a2 - noh) * noh + 1.0;
    return INV_PI * a2 / max(d * d, 1e-20);   // 1e-20: rounding may bring d to 0 in the middle of the sharpest highlight
}

// G2 / (4 nov nol), height-correlated. Heitz, "Understanding the Masking-Shadowing Function", JCGT 2014, eq. (99).
float smith_visibility(float nov, float nol, float alpha)
{
    float a2 = alpha * alpha;
    float lambdaV = nol * sqrt(nov * nov * (1.0 - a2) + a2);
    float lambdaL = nov * sqrt(nol * nol * (1.0 - a2) + a2);
    return 0.5 / max(lambdaV + lambdaL, 1e-7);   // 1e-7: both at grazing angles
}

Surface make_surface(vec3 normal, vec3 view, float opacity)
{
    Surface s;
    s.normal = normal;
    s.view = view;
    s.nov = clamp(dot(normal, view), 1e-4, 1.0);   // interpolated normals may turn away from the camera at a silhouette
    float roughness = clamp(input_roughness(), MIN_ROUGHNESS, 1.0);
    s.alpha = roughness * roughness;

    vec3 base = max(input_diffuse_color(), vec3(0.0));
#ifdef SPECULAR_WORKFLOW
    s.f0 = clamp(input_specular_color(), 0.0, 1.0);
    s.diffuse = base;
#else
    float metal = saturate(input_metallic());
    float reflectance = square((1.0 - input_ior()) / max(1.0 + input_ior(), 1e-4));
    s.f0 = clamp(mix(vec3(reflectance), base, metal), 0.0, 1.0);
    s.diffuse = base * (1.0 - metal);
#endif
    // Reflectances under 2 % do not exist: a darker one means "no specular" (Lagarde and de Rousiers 2014, 3.1.2).
    s.f90 = saturate(50.0 * max_component(s.f0));

    // Multiple scattering: Turquin, "Practical multiple scattering compensation for microfacet models", 2019, eq. (16).
    vec2 terms = albedo_terms(s.nov, roughness);
    s.compensation = 1.0 + s.f0 * (1.0 / max(terms.x + terms.y, 1e-3) - 1.0);
    s.specularAlbedo = (s.f0 * terms.x + s.f90 * terms.y) * s.compensation;
    s.diffuse *= (1.0 - min(s.specularAlbedo, vec3(1.0))) * opacity;

    s.baseWeight = 1.0;
    s.clearcoat = 0.0;
    s.clearcoatAlpha = 1.0;
    s.clearcoatAlbedo = 0.0;
#ifdef CLEARCOAT
    float coatRoughness = clamp(input_clearcoat_roughness(), MIN_ROUGHNESS, 1.0);
    float coatReflectance = square((1.0 - input_ior()) / max(1.0 + input_ior(), 1e-4));
    vec2 coatTerms = albedo_terms(s.nov, coatRoughness);
    s.clearcoat = saturate(input_clearcoat());
    s.clearcoatAlpha = coatRoughness * coatRoughness;
    s.clearcoatAlbedo = s.clearcoat * (coatReflectance * coatTerms.x + coatTerms.y);
    s.baseWeight = 1.0 - s.clearcoatAlbedo;
#endif
    return s;
}

// Diffuse and specular share of the BRDF times cosine, for one direction `light` and GGX widths made wider by a source's
// extent (`alpha` and `coatAlpha`; the loss in height is given back by (own / wider)^2).
vec3 surface_specular(Surface s, vec3 light, float spread)
{
    float nol = saturate(dot(s.normal, light));
    vec3 halfway = safe_normalize(light + s.view, s.normal);
    float noh = saturate(dot(s.normal, halfway));
    float voh = saturate(dot(s.view, halfway));
    float wide = saturate(s.alpha + spread);
    float lobe = ggx_distribution(noh, s.alpha) * square(s.alpha / wide) * smith_visibility(s.nov, nol, s.alpha);
    vec3 specular = s.baseWeight * lobe * fresnel_schlick(s.f0, s.f90, voh) * s.compensation;
#ifdef CLEARCOAT
    float coatWide = saturate(s.clearcoatAlpha + spread);
    float coatReflectance = square((1.0 - input_ior()) / max(1.0 + input_ior(), 1e-4));
    specular += s.clearcoat * ggx_distribution(noh, s.clearcoatAlpha) * square(s.clearcoatAlpha / coatWide)
        * smith_visibility(s.nov, nol, s.clearcoatAlpha) * fresnel_schlick(vec3(coatReflectance), 1.0, voh).x;
#endif
    return specular * nol;
}
