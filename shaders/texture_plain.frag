// One lookup with GL's own filter: what a zipmap's cost is measured against.
uniform sampler2D plain;

in vec2 st;

layout(location = 0) out vec4 out_color;

void main()
{
    out_color = texture(plain, st);
}
