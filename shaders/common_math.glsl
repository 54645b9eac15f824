// Constants and small functions of one line. Provides PI, INV_PI, square, saturate, safe_normalize, pow5.
const float PI = 3.14159265358979;
const float INV_PI = 0.318309886183791;

float square(float x) { return x * x; }

float pow5(float x)
{
    float x2 = x * x;
    return x2 * x2 * x;
}

float saturate(float x) { return clamp(x, 0.0, 1.0); }

float max_component(vec3 v) { return max(v.x, max(v.y, v.z)); }

// `fallback` for a vector too short to have a direction (1e-30 keeps its square above the smallest float).
vec3 safe_normalize(vec3 v, vec3 fallback)
{
    float lengthSquared = dot(v, v);
    return lengthSquared > 1e-30 ? v * inversesqrt(lengthSquared) : fallback;
}
