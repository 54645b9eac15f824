// What a place of an arrangement shows: hits gathered front to back, their shadows, then their images.
// Included by umbrella.glsl. Provides UmbrellaLook, umbrella_look, umbrella_compose.
#if UMBRELLA_DRAWN

// Coverage left below which nothing further back can change an 8-bit result.
const float UMBRELLA_OPAQUE = 1.0 / 2048.0;

// What is the same for all pixels of a texture in a view.
struct UmbrellaLook {
    UmbrellaGrid grid;
    ivec2 colorPage;
    int colorRowBits;
    float colorBlend;
    vec3 shadow;             // offset in cells, strength
    int umbrellas;           // address
    int images;              // record of the first base image
    int background;          // record of its image
    int imageTexels;         // of a record
};

UmbrellaLook umbrella_look(int record, vec2 cells)
{
    vec4 page = record_fetch(record + 4);
    vec4 colors = record_fetch(record + 5);
    vec4 shadow = record_fetch(record + 6);
    vec4 parts = record_fetch(record + 7);
    vec4 texels = record_fetch(record + 8);
    UmbrellaGrid grid = UmbrellaGrid(ivec2(page.xy), int(page.z), page.w, shadow.w, cells);
    return UmbrellaLook(grid, ivec2(colors.xy), int(colors.z), colors.w, shadow.xyz, int(parts.x), int(parts.y),
                        int(parts.z), int(texels.x));
}

vec3 umbrella_color(UmbrellaLook look, float index)
{
    int address = int(index);
    ivec2 place = ivec2(address & ((1 << look.colorRowBits) - 1), address >> look.colorRowBits);
    return texelFetch(pagesHalf, look.colorPage + place, 0).rgb;
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
        float coverage = umbrella_test(look.grid, at, sector, found);
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

// position: in cells, relative to base; dx, dy: its derivatives per pixel.
vec4 umbrella_compose(UmbrellaLook look, vec2 relative, vec2 base, ivec2 wrap, vec2 dx, vec2 dy, out float lod, out float patchIndex)
{
    vec3 s = wrap_locate(relative.x, base.x, look.grid.cells.x, wrap.x);
    vec3 t = wrap_locate(relative.y, base.y, look.grid.cells.y, wrap.y);
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
        // Search: up to three umbrellas, the third as if opaque only if it is.
        vec3 weights = vec3(0.0);
        vec3 sectors = vec3(0.0);
        vec3 numbers = vec3(-1.0);
        ivec3 entries = ivec3(list.x);
        float found = 0.0;
        float sector = -1.0;
        int tries = 0;
        bool running = list.y > 0 && clear > UMBRELLA_OPAQUE;
        do {
            UmbrellaPatchPlace at = umbrella_patch_place(look.grid, list.x, place);
            float begin = umbrella_first_sector(look.grid, at);
            sector = sector < 0.0 ? begin : sector;
            bool isFound;
            float coverage = umbrella_test(look.grid, at, sector, isFound);
            tries++;
            bool done = isFound || tries >= UMBRELLA_TRIES;
            bool hit = running && coverage > 0.0;
            bvec3 slot = bvec3(hit && found == 0.0, hit && found == 1.0, hit && found == 2.0);
            float weight = clear * coverage;
            weights = mix(weights, vec3(weight), slot);
            sectors = mix(sectors, vec3(sector), slot);
            numbers = mix(numbers, vec3(at.number), slot);
            entries = ivec3(slot.x ? list.x : entries.x, slot.y ? list.x : entries.y, slot.z ? list.x : entries.z);
            clear -= hit ? weight : 0.0;
            found += hit ? 1.0 : 0.0;
            list += running && done ? ivec2(UMBRELLA_STRIDE, -1) : ivec2(0);
            sector = done ? -1.0 : sector;
            tries = done ? 0 : tries;
            running = running && list.y > 0 && found < 3.0 && clear > UMBRELLA_OPAQUE;
        } while (running);
        more = list.y > 0 && clear > UMBRELLA_OPAQUE;
        // What is left shows the background, as the hit that comes last.
        bool open = found < 3.0 && !more && clear > UMBRELLA_OPAQUE;
        float behind = open ? clear : 0.0;
        weights += behind * vec3(found == 0.0, found == 1.0, found == 2.0);
        numbers = mix(numbers, vec3(16777216.0), bvec3(open && found == 0.0, open && found == 1.0, open && found == 2.0));
        clear -= behind;
        more = more || (!open && clear > UMBRELLA_OPAQUE);
#if UMBRELLA_SHADOWS
        vec3 light = umbrella_light(look, cell, place, numbers);
#else
        vec3 light = vec3(1.0);
#endif

        // Shade.
        do {
            bool isBackground = numbers.x > 16777215.0;
            UmbrellaPatchPlace at = umbrella_patch_place(look.grid, entries.x, place);
            vec4 head = umbrella_texel(look.grid, at.shape);
            int vertices = umbrella_vertices(look.grid, at.shape);
            vec2 a = umbrella_vertex(look.grid, vertices, sectors.x, at.morph);
            vec2 b = umbrella_vertex(look.grid, vertices, sectors.x + 1.0, at.morph);
            float area = umbrella_cross(a, b);
            float inverse = 1.0 / (area == 0.0 ? 1.0 : area);
            vec2 bary = vec2(umbrella_cross(at.point, b), umbrella_cross(a, at.point)) * inverse;
            float number = sectors.x - head.w * floor(sectors.x / head.w);
            vec4 corners = umbrella_texel(look.grid, vertices + int(head.w) + UMBRELLA_AFTER + int(number));
            vec2 alongA = corners.xy - head.xy;
            vec2 alongB = corners.zw - head.xy;
            vec2 uv = head.xy + bary.x * alongA + bary.y * alongB;
            vec2 uvdx = (umbrella_cross(at.dx, b) * alongA + umbrella_cross(a, at.dx) * alongB) * inverse;
            vec2 uvdy = (umbrella_cross(at.dy, b) * alongA + umbrella_cross(a, at.dy) * alongB) * inverse;
            uv = isBackground ? (cell + place.inside) / look.grid.cells : uv;
            uvdx = isBackground ? place.dx / look.grid.cells : uvdx;
            uvdy = isBackground ? place.dy / look.grid.cells : uvdy;
            int record = isBackground ? look.background : look.images + look.imageTexels * int(max(head.z, 0.0));
            Image image = image_open(record);
            float level = isotropic_level(uvdx * image.size, uvdy * image.size);
            vec4 texel = image_at_level(image, uv, level);
            bool plain = !isBackground && head.z < 0.0;
            texel = plain ? vec4(0.0, 0.0, 0.0, 1.0) : texel;
            vec4 umbrella = umbrella_texel(look.grid, look.umbrellas + int(isBackground ? 0.0 : numbers.x));
#if UMBRELLA_COLORS
            float next = number + 1.0 < head.w ? number + 2.0 : 1.0;
            vec3 offset = (1.0 - bary.x - bary.y) * umbrella_color(look, umbrella.x)
                        + bary.x * umbrella_color(look, umbrella.x + 1.0 + number)
                        + bary.y * umbrella_color(look, umbrella.x + next);
            vec3 varied = clamp(texel.rgb + look.colorBlend * texel.a * offset, vec3(0.0), vec3(texel.a));
            texel.rgb = isBackground ? texel.rgb : varied;
#endif
            color += weights.x * vec4(light.x * texel.rgb, texel.a);
            bool tells = isTop && weights.x > 0.0;
            topLod = tells ? level : topLod;
            top = tells && !isBackground ? numbers.x : top;
            isTop = isTop && !tells;
            weights = vec3(weights.yz, 0.0);
            sectors = vec3(sectors.yz, 0.0);
            numbers = vec3(numbers.yz, -1.0);
            entries = ivec3(entries.yz, entries.z);
            light = vec3(light.yz, 1.0);
        } while (weights.x > 0.0);
    } while (more);
    lod = topLod;
    patchIndex = top;
    return color;
}
#endif
