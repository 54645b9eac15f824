// One triangle over the whole target, without vertex buffers. `uv` is (0, 0) in the first row and column of the target.
#include "texture_vertex.glsl"
out vec2 uv;

void main()
{
    pass_texture_constants();
    uv = vec2(float((gl_VertexID << 1) & 2), float(gl_VertexID & 2));
    gl_Position = vec4(uv * 2.0 - 1.0, 0.0, 1.0);
}
