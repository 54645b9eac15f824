// Vertex side of texture_data.glsl: constants of a draw as flat varyings, which llvmpipe reads for a fraction of what a
// uniform costs per pixel. Provides pass_texture_constants.
#ifdef TEXTURE_FLAT
uniform vec4 textureConstants[TEXTURE_FLAT];
flat out vec4 textureFlat[TEXTURE_FLAT];

void pass_texture_constants()
{
    for (int i = 0; i < TEXTURE_FLAT; ++i)
        textureFlat[i] = textureConstants[i];
}
#else
void pass_texture_constants() {}
#endif
