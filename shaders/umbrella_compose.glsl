// What a place of an arrangement shows: hits gathered front to back, their shadows, then their images.
// Included by umbrella.glsl. Provides UmbrellaLook, umbrella_look, umbrella_compose.
// What is the same for all pixels of a texture in a view.
struct UmbrellaLook {
    UmbrellaGrid grid;
    ivec2 wrap;
    ivec2 colorPage;
    int colorRowBits;
    float colorBlend;
    vec3 shadow;             // offset in cells, strength
    int images;              // record of the first base image
    int background;          // record of its image
    int picture;             // record of the level's image
    int imageTexels;         // of a record
    int umbrellas;           // address
};

UmbrellaLook umbrella_look(vec2 cells, vec4 pages, vec4 tables, vec4 shadow, vec4 parts)
{
    int codes = int(tables.w);
    UmbrellaGrid grid = UmbrellaGrid(ivec2(pages.xy), (codes >> 4) & 31, tables.x, tables.y, cells);
    return UmbrellaLook(grid, ivec2(codes & 3, (codes >> 2) & 3), ivec2(pages.zw), codes >> 9, tables.z, shadow.xyz,
                        int(shadow.w), int(parts.x), int(parts.y), int(parts.z), int(parts.w));
}

#if UMBRELLA_DRAWN

// Coverage left below which nothing further back can change an 8-bit result.
const float UMBRELLA_OPAQUE = 1.0 / 2048.0;

vec4 umbrella_color(UmbrellaLook look, float index)
{
    int address = int(index);
    ivec2 place = ivec2(address & ((1 << look.colorRowBits) - 1), address >> look.colorRowBits);
    return texelFetch(pagesHalf, look.colorPage + place, 0);
}

// The list of a cell: first entry, number of entries.
ivec2 umbrella_list(UmbrellaGrid grid, vec2 cell)
{
    return ivec2(umbrella_texel(grid, int(cell.y) * int(grid.cells.x) + int(cell.x)).xy);
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
    bool running = list.y > 0;
    do {
        UmbrellaPatchPlace at = umbrella_patch_place(look.grid, list.x, place);
        running = running && at.number < last;
        float begin = umbrella_first_sector(look.grid, at);
        sector = sector < 0.0 ? begin : sector;
        bool found;
        float coverage = umbrella_test(look.grid, at, sector, found).coverage;
        clear *= 1.0 - (running ? coverage : 0.0) * step(vec3(at.number + 0.5), numbers);
        tries++;
        bool done = found || tries >= UMBRELLA_TRIES;
        sector = done ? -1.0 : sector;
        tries = done ? 0 : tries;
        list += running && done ? ivec2(UMBRELLA_STRIDE, -1) : ivec2(0);
        running = running && list.y > 0 && max(clear.x, max(clear.y, clear.z)) > UMBRELLA_OPAQUE;
    } while (running);
    return 1.0 - look.shadow.z * (1.0 - clear);
}
#endif

// A hit that waits to be shaded.
struct UmbrellaFound {
    vec4 what;               // weight; umbrella, by its first colour where there are colours; sector; shape
    vec2 place;              // as of UmbrellaHit
    vec4 slope;
};

#define UMBRELLA_BACKGROUND 16777216.0       // in place of the umbrella

UmbrellaFound umbrella_nothing()
{
    return UmbrellaFound(vec4(0.0, -1.0, 0.0, 0.0), vec2(0.0), vec4(0.0));
}

UmbrellaFound umbrella_background(float weight)
{
    return UmbrellaFound(vec4(weight, UMBRELLA_BACKGROUND, 0.0, 0.0), vec2(0.0), vec4(0.0));
}

UmbrellaFound umbrella_found(UmbrellaHit hit, UmbrellaPatchPlace at, float weight)
{
    return UmbrellaFound(vec4(weight, at.number, hit.sector, float(at.shape)), hit.place, hit.slope);
}

void umbrella_take(inout UmbrellaFound found, UmbrellaFound now, bool taken)
{
    found.what = mix(found.what, now.what, bvec4(taken));
    found.place = mix(found.place, now.place, bvec2(taken));
    found.slope = mix(found.slope, now.slope, bvec4(taken));
}

// position: in cells, relative to base; dx, dy: its derivatives per pixel.
vec4 umbrella_compose(UmbrellaLook look, vec2 relative, vec2 base, vec2 dx, vec2 dy, out float lod,
                      out float patchIndex)
{
    vec3 s = wrap_locate(relative.x, base.x, look.grid.cells.x, look.wrap.x);
    vec3 t = wrap_locate(relative.y, base.y, look.grid.cells.y, look.wrap.y);
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
        // Search: up to three umbrellas.
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
            list += running && done ? ivec2(UMBRELLA_STRIDE, -1) : ivec2(0);
            sector = done ? -1.0 : sector;
            tries = done ? 0 : tries;
            running = running && list.y > 0 && found < 3.0 && clear > UMBRELLA_OPAQUE;
        } while (running);
        more = list.y > 0 && clear > UMBRELLA_OPAQUE;
        // What is left shows the background, as the hit that comes last.
        bool open = found < 3.0 && !more && clear > UMBRELLA_OPAQUE;
        UmbrellaFound behind = umbrella_background(clear);
        umbrella_take(first, behind, open && found == 0.0);
        umbrella_take(second, behind, open && found == 1.0);
        umbrella_take(third, behind, open && found == 2.0);
        clear -= open ? clear : 0.0;
        more = more || clear > UMBRELLA_OPAQUE;
#if UMBRELLA_SHADOWS
        vec3 light = umbrella_light(look, cell, place, vec3(first.what.y, second.what.y, third.what.y));
#else
        vec3 light = vec3(1.0);
#endif

        // Shade.
        do {
            float weight = first.what.x;
            bool isBackground = first.what.y >= UMBRELLA_BACKGROUND;
            int shape = int(first.what.w);
            vec4 head = umbrella_texel(look.grid, shape);
            float number = first.what.z - (first.what.z < head.w ? 0.0 : head.w);
            vec4 corners = umbrella_texel(look.grid, umbrella_vertices(look.grid, shape) + int(head.w + number) + UMBRELLA_AFTER);
            vec2 alongA = corners.xy - head.xy;
            vec2 alongB = corners.zw - head.xy;
            vec2 uv = head.xy + first.place.x * alongA + first.place.y * alongB;
            vec2 uvdx = first.slope.x * alongA + first.slope.y * alongB;
            vec2 uvdy = first.slope.z * alongA + first.slope.w * alongB;
            uv = isBackground ? (cell + place.inside) / look.grid.cells : uv;
            uvdx = isBackground ? place.dx / look.grid.cells : uvdx;
            uvdy = isBackground ? place.dy / look.grid.cells : uvdy;
            int record = isBackground ? look.background : look.images + look.imageTexels * int(max(head.z, 0.0));
            Image image = image_open(record);
            float level = isotropic_level(uvdx * image.size, uvdy * image.size);
            vec4 texel = image_at_level(image, uv, level);
            texel = !isBackground && head.z < 0.0 ? vec4(0.0, 0.0, 0.0, 1.0) : texel;
#if UMBRELLA_COLORS
            float begin = isBackground ? 0.0 : first.what.y;
            float next = number + 1.0 < head.w ? number + 2.0 : 1.0;
            vec4 center = umbrella_color(look, begin);
            vec4 colorA = umbrella_color(look, begin + 1.0 + number);
            vec4 colorB = umbrella_color(look, begin + next);
            vec3 offset = (1.0 - first.place.x - first.place.y) * center.rgb + first.place.x * colorA.rgb + first.place.y * colorB.rgb;
            vec3 varied = clamp(texel.rgb + look.colorBlend * texel.a * offset, vec3(0.0), vec3(texel.a));
            texel.rgb = isBackground ? texel.rgb : varied;
            float index = center.a + 2048.0 * colorA.a;
#else
            float index = first.what.y;
#endif
            color += weight * vec4(light.x * texel.rgb, texel.a);
            bool tells = isTop && weight > 0.0;
            topLod = tells ? level : topLod;
            top = tells && !isBackground ? index : top;
            isTop = isTop && !tells;
            first = second;
            second = third;
            third.what.x = 0.0;
            light = vec3(light.yz, 1.0);
        } while (first.what.x > 0.0);
    } while (more);
    lod = topLod;
    patchIndex = top;
    return color;
}
#endif
