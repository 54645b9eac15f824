// The environment behind everything.
#include "common_math.glsl"
#include "common_latlong.glsl"

uniform sampler2D domeRadiance;
uniform float largestValue;
in vec3 nearPoint;
in vec3 farPoint;
out vec4 outColor;

void main()
{
    vec3 direction = normalize(farPoint - nearPoint);
    vec3 radiance = textureLod(domeRadiance, latlong_uv(direction), 0.0).rgb;
    outColor = vec4(min(radiance, vec3(largestValue)), 1.0);
}
