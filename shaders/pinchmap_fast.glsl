// Pinchmaps by the paper's program: one bilinear access to the pinchmap, one to the signal (two where the view shows two of
// its mip levels). Included by pinchmap.glsl. Provides pinchmap_fast_sample.
//
// For affine maps without anisotropic probes, seen so that neither float32 coordinates nor the 8-bit weights of hardware
// filters show. What is known of each texture is compiled in, constants come as flat varyings.
//
// Defines: PINCHMAP_FLAT first of the varyings, PINCHMAP_CONSTANTS per slot; PINCHMAP_CODES<slot>, of all 8: 1
// + 2 signal seen at two mip levels + 4 minified somewhere + 8 solid line + 16 pinchmap in the float pages + 32 signal in
// the half-float pages + 64 * wrap mode along s + 256 * along t.
//
// Varyings: position.x from (s, t, 1), h; position.y, antialias; size of the pinchmap, line width, mip level at a footprint
// of 1 over the finest one; then scale.xy, offset.xy from position to page coordinates of the pinchmap, of the finest
// level of the signal, and where any slot has them: of the next level; line colour, premultiplied.
#if PINCHMAP_FAST

int pinchmap_codes(int slot)
{
    return slot == 0 ? PINCHMAP_CODES0 : slot == 1 ? PINCHMAP_CODES1 : slot == 2 ? PINCHMAP_CODES2
         : slot == 3 ? PINCHMAP_CODES3 : slot == 4 ? PINCHMAP_CODES4 : slot == 5 ? PINCHMAP_CODES5
         : slot == 6 ? PINCHMAP_CODES6 : PINCHMAP_CODES7;
}

#define PINCHMAP_CONSTANT(slot, i) textureFlat[PINCHMAP_FLAT + PINCHMAP_CONSTANTS * (slot) + (i)]

vec4 pinchmap_fast_texel(vec2 page, bool isFloat)
{
#if PINCHMAP_SNORM && PINCHMAP_FLOAT
    if (isFloat)
        return textureLod(pagesFloat, page, 0.0);
    return textureLod(pagesSnorm, page, 0.0);
#elif PINCHMAP_FLOAT
    return textureLod(pagesFloat, page, 0.0);
#else
    return textureLod(pagesSnorm, page, 0.0);
#endif
}

// All of `codes` is known when compiled, so that no branch on it is left.
vec4 pinchmap_fast_sample(int slot, vec2 st, vec2 dstdx, vec2 dstdy, out float lod)
{
    int codes = pinchmap_codes(slot);
    ivec2 wrap = ivec2((codes >> 6) & 3, (codes >> 8) & 3);
    vec4 x = PINCHMAP_CONSTANT(slot, 0);
    vec4 y = PINCHMAP_CONSTANT(slot, 1);
    vec4 sizes = PINCHMAP_CONSTANT(slot, 2);
    vec4 toPinchmap = PINCHMAP_CONSTANT(slot, 3);
    vec4 toSignal = PINCHMAP_CONSTANT(slot, 4);
    vec2 position = vec2(x.x * st.x + x.y * st.y + x.z, y.x * st.x + y.y * st.y + y.z);
    position = vec2(pinchmap_wrap(position.x, sizes.x, wrap.x), pinchmap_wrap(position.y, sizes.y, wrap.y));
    vec2 dx = vec2(dot(x.xy, dstdx), dot(y.xy, dstdx));
    vec2 dy = vec2(dot(x.xy, dstdy), dot(y.xy, dstdy));
    float level = isotropic_level(dx, dy);
    float blend = level + sizes.w;
    lod = blend + float(pinchmapRecord[slot].y);

    vec4 texel = pinchmap_fast_texel(position * toPinchmap.xy + toPinchmap.zw, (codes & 16) != 0);
    float edge = pinch_edge(texel);
    vec2 gradient = vec2(dFdx(edge), dFdy(edge));
    float footprint = (codes & 4) != 0 ? exp2(level) : 0.0;
    vec2 place = position + pinch_displace(texel, position, gradient, x.w, y.w, footprint);
    place = vec2(pinchmap_wrap(place.x, sizes.x, wrap.x), pinchmap_wrap(place.y, sizes.y, wrap.y));

    bool isHalf = (codes & 32) != 0;
    vec4 color = pinchmap_signal(place * toSignal.xy + toSignal.zw, isHalf);
    if ((codes & 2) != 0) {
        vec4 toCoarser = PINCHMAP_CONSTANT(slot, 5);
        color = mix(color, pinchmap_signal(place * toCoarser.xy + toCoarser.zw, isHalf), clamp(blend, 0.0, 1.0));
    }
    LOOKUP_COUNT((codes & 2) != 0 ? 12.0 : 8.0);
    if ((codes & 8) != 0) {
        float coverage = pinch_line(texel, position, gradient, dx, dy, sizes.z, y.w, footprint);
        color = pinchmap_over(color, PINCHMAP_CONSTANT(slot, PINCHMAP_CONSTANTS - 1), coverage);
    }
    return color;
}
#endif
