// A triangle over the whole view, with the direction that each of its points is seen in.
uniform mat4 eyeFromClip;
uniform vec2 clipOffset;
out vec3 nearPoint;
out vec3 farPoint;

vec3 unprojected(vec4 clip)
{
    vec4 point = eyeFromClip * clip;
    return point.xyz / point.w;
}

void main()
{
    vec2 corner = vec2(float((gl_VertexID << 2) & 4), float((gl_VertexID << 1) & 4)) - 1.0;
    nearPoint = unprojected(vec4(corner, -1.0, 1.0));
    farPoint = unprojected(vec4(corner, 0.0, 1.0));
    gl_Position = vec4(corner + clipOffset, 0.0, 1.0);
}
