// One level of the dome's radiance, seen through a GGX lobe around each direction, view = normal = mirror direction.
// Karis, "Real Shading in Unreal Engine 4", 2013; sample levels: Krivanek and Colbert, "Real-time Shading with Filtered
// Importance Sampling", 2008, eq. (13).
#include "common_math.glsl"
#include "common_latlong.glsl"

uniform sampler2D dome;          // mip-mapped
uniform float alpha;             // GGX width; 0 copies
in vec2 uv;
out vec4 outRadiance;

const int SAMPLE_COUNT = 64;

// Van der Corput sequence in base 2.
float radical_inverse(uint i)
{
    i = (i << 16u) | (i >> 16u);
    i = ((i & 0x55555555u) << 1u) | ((i & 0xAAAAAAAAu) >> 1u);
    i = ((i & 0x33333333u) << 2u) | ((i & 0xCCCCCCCCu) >> 2u);
    i = ((i & 0x0F0F0F0Fu) << 4u) | ((i & 0xF0F0F0F0u) >> 4u);
    i = ((i & 0x00FF00FFu) << 8u) | ((i & 0xFF00FF00u) >> 8u);
    return float(i) * 2.3283064365386963e-10;
}

mat3 frame_around(vec3 normal)
{
    vec3 up = abs(normal.y) < 0.9 ? vec3(0.0, 1.0, 0.0) : vec3(1.0, 0.0, 0.0);
    vec3 tangent = normalize(cross(up, normal));
    return mat3(tangent, cross(normal, tangent), normal);
}

void main()
{
    vec3 normal = latlong_direction(uv);
    if (alpha <= 0.0)
    {
        outRadiance = vec4(textureLod(dome, uv, 0.0).rgb, 1.0);
        return;
    }
    mat3 frame = frame_around(normal);
    ivec2 size = textureSize(dome, 0);
    float texelAngle = 2.0 * PI * PI / float(size.x * size.y);   // mean solid angle of a texel
    vec3 sum = vec3(0.0);
    float weights = 0.0;
    for (int i = 0; i < SAMPLE_COUNT; ++i)
    {
        vec2 u = vec2((float(i) + 0.5) / float(SAMPLE_COUNT), radical_inverse(uint(i)));
        float cosine = sqrt((1.0 - u.x) / (1.0 + (alpha * alpha - 1.0) * u.x));
        float sine = sqrt(max(1.0 - cosine * cosine, 0.0));
        vec3 halfway = vec3(sine * cos(2.0 * PI * u.y), sine * sin(2.0 * PI * u.y), cosine);
        vec3 light = 2.0 * cosine * halfway - vec3(0.0, 0.0, 1.0);
        if (light.z <= 0.0)
            continue;
        float d = (cosine * alpha * alpha - cosine) * cosine + 1.0;
        float density = INV_PI * alpha * alpha / max(d * d, 1e-20) * 0.25;   // as in surface_brdf; noh = voh
        float sampleAngle = 1.0 / (float(SAMPLE_COUNT) * density);
        float level = max(0.5 * log2(sampleAngle / texelAngle) + 1.0, 0.0);
        sum += textureLod(dome, latlong_uv(frame * light), level).rgb * light.z;
        weights += light.z;
    }
    outRadiance = vec4(sum / max(weights, 1e-6), 1.0);
}
