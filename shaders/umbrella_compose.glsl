// What a place of an arrangement shows: hits gathered front to back, their shadows, then their images.
// Included by umbrella.glsl. Provides UmbrellaLook, umbrella_look, umbrella_compose.
// What is the same for all pixels of a texture in a view.
struct UmbrellaLook {
    UmbrellaGrid grid;
    ivec2 wrap;
    ivec2 colorPage;
    int colorRowBits;        // 0 without colours
    float colorBlend;
    vec3 shadow;             // offset in cells, strength
    int images;              // record of the first base image
    int background;          // record of its image
    int picture;             // record of the level's image
    int imageTexels;         // of a record
    float vectorHand;        // 1 where texels are vectors, -1 where one of their axes runs backward, else 0
    float imageProbes;       // most that a lookup in an image may take
};

uniform float umbrellaImageProbes;

UmbrellaLook umbrella_look(vec2 cells, vec4 pages, vec4 tables, vec4 shadow, vec4 parts)
{
    int codes = int(tables.w);
    int vectors = (codes >> 14) & 3;
    UmbrellaGrid grid = UmbrellaGrid(ivec2(pages.xy), (codes >> 4) & 31, tables.x, tables.y, int(parts.w), cells);
    return UmbrellaLook(grid, ivec2(codes & 3, (codes >> 2) & 3), ivec2(pages.zw), (codes >> 9) & 31, tables.z, shadow.xyz,
                        int(shadow.w), int(parts.x), int(parts.y), int(parts.z),
                        vectors == 2 ? -1.0 : float(vectors), codes < 65536 ? 1.0 : umbrellaImageProbes);
}

#if UMBRELLA_DRAWN

#define UMBRELLA_ACCESS (IMAGE_LEVELS > 1 ? 8.0 : 4.0)

// Coverage left below which nothing further back can change an 8-bit result.
const float UMBRELLA_OPAQUE = 1.0 / 2048.0;

#if UMBRELLA_COLORS
// A vertex colour; the fourth component tells the umbrella, low part at its centre, high part around.
vec4 umbrella_color(UmbrellaLook look, float index)
{
    int address = int(index);
    ivec2 place = ivec2(address & ((1 << look.colorRowBits) - 1), address >> look.colorRowBits);
    return texelFetch(pagesHalf, look.colorPage + place, 0);
}
#endif

// The list of a cell: first entry, number of entries; none of a texture of which this view shows only the picture.
ivec2 umbrella_list(UmbrellaGrid grid, vec2 cell)
{
    ivec2 list = ivec2(umbrella_texel(grid, int(cell.y) * int(grid.cells.x) + int(cell.x)).xy);
    return grid.stride > 0 ? list : ivec2(0);
}

// Where in its image a hit looks.
struct UmbrellaTexel {
    vec2 uv;
    vec2 dx;
    vec2 dy;
    float image;             // number, -1 for none
    vec2 vertices;           // of the sector, counted from 1
};

UmbrellaTexel umbrella_texel_place(UmbrellaLook look, int shape, float sector, vec2 place, vec4 slope)
{
    vec4 head = umbrella_texel(look.grid, shape);
    float number = sector - (sector < head.w ? 0.0 : head.w);
    vec4 corners = umbrella_texel(look.grid, umbrella_vertices(look.grid, shape) + int(head.w + number) + UMBRELLA_AFTER);
    vec2 alongA = corners.xy - head.xy;
    vec2 alongB = corners.zw - head.xy;
    return UmbrellaTexel(head.xy + place.x * alongA + place.y * alongB, slope.x * alongA + slope.y * alongB,
                         slope.z * alongA + slope.w * alongB, head.z,
                         vec2(number + 1.0, number + 1.0 < head.w ? number + 2.0 : 1.0));
}

// The image of a shape, opaque black without one; trilinear, where the texture has no filter of its own for what probes
// leave. Linear, premultiplied.
vec4 umbrella_image(UmbrellaLook look, UmbrellaTexel at, int record, out float level)
{
    Image image = image_open(record);
#if UMBRELLA_FILTERED
    vec4 texel = image_filter(image, at.uv, at.dx, at.dy, look.imageProbes, level);
#else
    level = isotropic_level(at.dx * image.size, at.dy * image.size);
    vec4 texel = image_at_level(image, at.uv, level - image.bias);
#endif
    return at.image < 0.0 ? vec4(0.0, 0.0, 0.0, 1.0) : texel;
}

int umbrella_image_record(UmbrellaLook look, float image)
{
    return look.images + look.imageTexels * int(max(image, 0.0));
}

#if UMBRELLA_SHADOWS
// Light that reaches up to three hits, given by the numbers of their umbrellas: each is shaded by those in front of it
// that cover the place moved against the shadow offset (section 6.2).
vec3 umbrella_light(UmbrellaLook look, vec2 cell, UmbrellaPlace place, vec3 numbers)
{
    vec2 moved = place.inside - look.shadow.xy;
    vec2 whole = floor(moved);
    place.inside = moved - whole;
    cell += whole;
    cell -= look.grid.cells * floor(cell / look.grid.cells);
    cell = clamp(cell, vec2(0.0), look.grid.cells - 1.0);
    ivec2 list = umbrella_list(look.grid, cell);
    float last = max(numbers.x, max(numbers.y, numbers.z));
    vec3 clear = step(vec3(0.0), numbers);
    float sector = -1.0;
    int tries = 0;
    bool running = list.y > 0 && umbrella_texel(look.grid, list.x).w < last;
    do {
        UmbrellaPatchPlace at = umbrella_patch_place(look.grid, list.x, place);
        float begin = umbrella_first_sector(look.grid, at);
        sector = sector < 0.0 ? begin : sector;
        bool found;
        UmbrellaHit hit = umbrella_test(look.grid, at, sector, found);
        float coverage = hit.coverage;
#if UMBRELLA_ALPHA
        UmbrellaTexel texel = umbrella_texel_place(look, at.shape, hit.sector, hit.place, hit.slope);
        float level;
        coverage *= umbrella_image(look, texel, umbrella_image_record(look, texel.image), level).a;
#if !UMBRELLA_FILTERED
        LOOKUP_COUNT(running ? UMBRELLA_ACCESS : 0.0);
#endif
#endif
        clear *= 1.0 - (running ? coverage : 0.0) * step(vec3(at.number + 0.5), numbers);
        tries++;
        bool done = found || tries >= UMBRELLA_TRIES;
        sector = done ? -1.0 : sector;
        tries = done ? 0 : tries;
        list += running && done ? ivec2(look.grid.stride, -1) : ivec2(0);
        bool isDark = max(clear.x, max(clear.y, clear.z)) <= UMBRELLA_OPAQUE;
        // The number of the next one, alone, spares most pixels a round.
        running = running && list.y > 0 && !isDark && umbrella_texel(look.grid, list.x).w < last;
    } while (running);
    return 1.0 - look.shadow.z * (1.0 - clear);
}
#endif

// A hit that waits to be shaded.
struct UmbrellaFound {
    vec4 what;               // weight; umbrella, by its first colour where there are colours; sector; shape
    vec2 place;              // as of UmbrellaHit
    vec4 slope;
#if UMBRELLA_VECTORS
    vec3 turn;               // as of UmbrellaPatchPlace
#endif
};

// How many hits are searched for before they are shaded: where images have alpha, it decides what is seen further back.
#if UMBRELLA_ALPHA
#define UMBRELLA_SEARCHED 1.0
#else
#define UMBRELLA_SEARCHED 3.0
#endif

#define UMBRELLA_BACKGROUND 16777216.0       // in place of the umbrella

UmbrellaFound umbrella_nothing()
{
    UmbrellaFound found;
    found.what = vec4(0.0, -1.0, 0.0, 0.0);
    found.place = vec2(0.0);
    found.slope = vec4(0.0);
#if UMBRELLA_VECTORS
    found.turn = vec3(1.0, 1.0, 0.0);
#endif
    return found;
}

UmbrellaFound umbrella_found(UmbrellaHit hit, UmbrellaPatchPlace at, float weight)
{
    UmbrellaFound found;
    found.what = vec4(weight, at.number, hit.sector, float(at.shape));
    found.place = hit.place;
    found.slope = hit.slope;
#if UMBRELLA_VECTORS
    found.turn = at.look;
#endif
    return found;
}

void umbrella_take(inout UmbrellaFound found, UmbrellaFound now, bool taken)
{
    found.what = mix(found.what, now.what, bvec4(taken));
    found.place = mix(found.place, now.place, bvec2(taken));
    found.slope = mix(found.slope, now.slope, bvec4(taken));
#if UMBRELLA_VECTORS
    found.turn = mix(found.turn, now.turn, bvec3(taken));
#endif
}

// position: in cells, relative to base; dx, dy: its derivatives per pixel.
vec4 umbrella_compose(UmbrellaLook look, vec2 relative, vec2 base, vec2 dx, vec2 dy, out float lod,
                      out float patchIndex)
{
    vec3 s = wrap_locate(relative.x, base.x, look.grid.cells.x, look.wrap.x);
    vec3 t = wrap_locate(relative.y, base.y, look.grid.cells.y, look.wrap.y);
    // Where the place is clamped the pixel keeps its size, as for hardware: without it edges had no width to be soft across.
    vec2 turned = vec2(s.z < 0.0 ? -1.0 : 1.0, t.z < 0.0 ? -1.0 : 1.0);
    vec2 cell = vec2(s.x, t.x);
    UmbrellaPlace place = UmbrellaPlace(vec2(s.y, t.y), turned * dx, turned * dy);
    ivec2 list = umbrella_list(look.grid, cell);

    vec4 color = vec4(0.0);
    float clear = 1.0;
    float topLod = 0.0;
    float top = -1.0;
    bool isTop = true;
    bool more;
    do {
        // Search.
        UmbrellaFound first = umbrella_nothing();
        UmbrellaFound second = first;
        UmbrellaFound third = first;
        float found = 0.0;
        float sector = -1.0;
        int tries = 0;
        bool running = list.y > 0 && clear > UMBRELLA_OPAQUE;
        do {
            UmbrellaPatchPlace at = umbrella_patch_place(look.grid, list.x, place);
            float begin = umbrella_first_sector(look.grid, at);
            sector = sector < 0.0 ? begin : sector;
            bool isFound;
            UmbrellaHit hit = umbrella_test(look.grid, at, sector, isFound);
            tries++;
            bool done = isFound || tries >= UMBRELLA_TRIES;
            bool isHit = running && hit.coverage > 0.0;
            UmbrellaFound now = umbrella_found(hit, at, clear * hit.coverage);
            umbrella_take(first, now, isHit && found == 0.0);
            umbrella_take(second, now, isHit && found == 1.0);
            umbrella_take(third, now, isHit && found == 2.0);
            clear -= isHit ? now.what.x : 0.0;
            found += isHit ? 1.0 : 0.0;
            list += running && done ? ivec2(look.grid.stride, -1) : ivec2(0);
            sector = done ? -1.0 : sector;
            tries = done ? 0 : tries;
            running = running && list.y > 0 && found < UMBRELLA_SEARCHED && clear > UMBRELLA_OPAQUE;
        } while (running);
        // What is left at the end of the list shows the background, as the hit that comes last.
        bool isLast = found < UMBRELLA_SEARCHED && clear > UMBRELLA_OPAQUE;
        UmbrellaFound behind = umbrella_nothing();
        behind.what.xy = vec2(clear, UMBRELLA_BACKGROUND);
        umbrella_take(first, behind, isLast && found == 0.0);
        umbrella_take(second, behind, isLast && found == 1.0);
        umbrella_take(third, behind, isLast && found == 2.0);
        clear -= isLast ? clear : 0.0;
#if UMBRELLA_SHADOWS
        vec3 light = umbrella_light(look, cell, place, vec3(first.what.y, second.what.y, third.what.y));
#else
        vec3 light = vec3(1.0);
#endif

        // Shade.
        do {
            float weight = first.what.x;
            bool isBackground = first.what.y >= UMBRELLA_BACKGROUND;
            UmbrellaTexel at = umbrella_texel_place(look, int(first.what.w), first.what.z, first.place, first.slope);
            int record = isBackground ? look.background : umbrella_image_record(look, at.image);
            at.uv = isBackground ? (cell + place.inside) / look.grid.cells : at.uv;
            at.dx = isBackground ? place.dx / look.grid.cells : at.dx;
            at.dy = isBackground ? place.dy / look.grid.cells : at.dy;
            at.image = isBackground ? 0.0 : at.image;
            float level;
            vec4 texel = umbrella_image(look, at, record, level);
#if !UMBRELLA_FILTERED
            LOOKUP_COUNT(weight > 0.0 ? UMBRELLA_ACCESS : 0.0);
#endif
            float index = first.what.y;
#if UMBRELLA_COLORS
            float begin = isBackground ? 0.0 : first.what.y;
            vec4 center = umbrella_color(look, begin);
            vec4 colorA = umbrella_color(look, begin + at.vertices.x);
            vec4 colorB = umbrella_color(look, begin + at.vertices.y);
            float inner = 1.0 - first.place.x - first.place.y;
            vec3 offset = inner * center.rgb + first.place.x * colorA.rgb + first.place.y * colorB.rgb;
            vec3 varied = texel.rgb + look.colorBlend * texel.a * offset;
            index = look.colorRowBits > 0 ? center.a + 2048.0 * colorA.a : index;
#else
            vec3 varied = texel.rgb;
#endif
            varied = clamp(varied, vec3(0.0), vec3(texel.a));
#if UMBRELLA_VECTORS
            vec2 vector = 2.0 * varied.xy - texel.a;
            float mirror = first.turn.x < 0.0 ? -1.0 : 1.0;
            float sine = look.vectorHand * first.turn.z;
            vec2 turned = 0.5 * (vec2(first.turn.y * vector.x - mirror * sine * vector.y,
                                      sine * vector.x + mirror * first.turn.y * vector.y) + texel.a);
            varied.xy = look.vectorHand != 0.0 ? turned : varied.xy;
#endif
            texel.rgb = isBackground ? texel.rgb : varied;
            color += weight * vec4(light.x * texel.rgb, texel.a);
#if UMBRELLA_ALPHA
            clear += isBackground ? 0.0 : weight * (1.0 - texel.a);
#endif
            bool tells = isTop && weight * texel.a > 0.0;
            topLod = tells ? level : topLod;
            top = tells && !isBackground ? index : top;
            isTop = isTop && !tells;
            first = second;
            second = third;
            third.what.x = 0.0;
            light = vec3(light.yz, 1.0);
        } while (first.what.x > 0.0);
        more = !isLast && clear > UMBRELLA_OPAQUE;
    } while (more);
    lod = topLod;
    patchIndex = top;
    return color;
}
#endif
