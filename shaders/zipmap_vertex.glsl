// Vertex side of zipmap_list.glsl: constants of a draw as flat varyings, which llvmpipe reads for a fraction of what a
// uniform costs per pixel. Provides pass_zipmap_layers.
#ifdef ZIPMAP_FLAT
uniform vec4 zipmapLayers[ZIPMAP_FLAT];
flat out vec4 zipmapFlat[ZIPMAP_FLAT];

void pass_zipmap_layers()
{
    for (int i = 0; i < ZIPMAP_FLAT; ++i)
        zipmapFlat[i] = zipmapLayers[i];
}
#else
void pass_zipmap_layers() {}
#endif
