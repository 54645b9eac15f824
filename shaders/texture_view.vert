// A surface given in clip space with its local texture coordinates; nothing is transformed.
#include "texture_vertex.glsl"
in vec4 in_position;
in vec2 in_st;

out vec2 st;

void main()
{
    pass_texture_constants();
    st = in_st;
    gl_Position = in_position;
}
