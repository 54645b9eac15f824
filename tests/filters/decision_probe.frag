// Camera directions of one row, all with the same frame: colour and decision of each.
uniform sampler2D directions;
uniform mat3 frame;
uniform float intensity;

layout(location = 0) out vec4 outColor;
layout(location = 1) out vec4 outDecision;

void main()
{
    vec3 toCamera = texelFetch(directions, ivec2(gl_FragCoord.xy), 0).xyz;
    outColor = vec4(decision_color(toCamera, frame, intensity), 1.0);
    outDecision = vec4(decision_shear(toCamera, frame), decision_filter(toCamera, frame), 1.0);
}
