// Zipmaps of any number of layers: the index gives the layers of a place, a loop looks at those that cover it.
// Included by zipmap.glsl. Provides zipmap_tree_sample.
//
// Defines: ZIPMAP_LEVELS 1 where every image is seen at one mip level only, else 2; ZIPMAP_PROBES 1 for anisotropic
// filtering, ZIPMAP_MIXED 1 where not all layers may take as many probes; ZIPMAP_PLAIN 1 where any are looked up here.
//
// The record texture holds, written by fexel/textures/records.py:
//   node    leaf: (first record, number of records, 0, 0); inner: (first child, -children per axis, 0, 0)
//   record  3 texels: rows of the matrix from (s, t, 1) to texels of level 0 (x right, y down, w) with width, height and
//           codes = finest level + 16 coarsest level + 256 page class + opacity / 2 in their last components; then
//           (index of the layer, kind, record, most probes): kind + filter / 8 and own record of a texture of another kind,
//           kind 0 for an image that is looked up here, -1 with the record of image.glsl for one that is looked up there;
//           then per level: scale.xy, offset.xy from texels of level 0 to page coordinates.
// Records of a leaf follow each other front to back; the last one is the root, opaque or not.
//
// llvmpipe runs 8 pixels in step, a branch skips nothing, and a loop ends when all are done. Hence do-while loops, which
// never run once too often, and a search by arithmetic alone before each fetch. Mesa 22.3 goes on computing temporaries for
// pixels that have left a loop, from variables that already have their new values: so what is read after a loop must be
// assigned in a way that a repetition of its last round does not change. The searches below do not advance in their last
// round for that reason.
#if ZIPMAP_TREE

#define ZIPMAP_AUTO 5.0                      // of fexel.filters.FILTERS: the lookup tells what it took

uniform vec4 zipmapGrid[ZIPMAP_SLOTS];       // st -> cell: scale.xy, offset.xy
uniform ivec4 zipmapTree[ZIPMAP_SLOTS];      // first node, cells along s, cells along t
uniform float zipmapMaxProbes;

// Coverage left below which nothing further back can change an 8-bit result.
const float ZIPMAP_OPAQUE = 1.0 / 2048.0;
// Pixels beyond its place that a lookup sees: of prefiltered images, whose borders fade outward; with probes.
const float ZIPMAP_REACH = ZIPMAP_FILTERED == 1 ? 2.0 : 0.5;
#define ZIPMAP_FILTERED_IMAGE -1

// Leaf of the index that holds st: (first record, number of records).
ivec2 zipmap_leaf(int slot, vec2 st)
{
    vec2 cells = vec2(zipmapTree[slot].yz);
    vec2 position = clamp(st * zipmapGrid[slot].xy + zipmapGrid[slot].zw, vec2(0.0), cells - 0.001);
    vec2 cell = floor(position);
    vec2 inside = position - cell;
    int index = zipmapTree[slot].x + int(cell.y) * zipmapTree[slot].y + int(cell.x);
    vec4 node;
    bool isInner;
    do {
        node = record_fetch(index);
        isInner = node.y < 0.0;
        float children = -node.y;
        position = inside * children;
        cell = min(floor(position), children - 1.0);
        inside = isInner ? position - cell : inside;
        index = isInner ? int(node.x) + int(cell.y) * int(children) + int(cell.x) : index;
    } while (isInner);
    return ivec2(node.xy);
}

// One bilinear fetch. texel: of level 0; size: of level 0; level: its record; pageClass 0 sRGB, 1 half.
// Where a texel coordinate can lie outside of the image, it stops at the centre of the border texel, which is zero for
// patches and where wrap is black.
#if ZIPMAP_OUTSIDE || ZIPMAP_PROBES || ZIPMAP_FILTERED
#define ZIPMAP_STOP(page, begin, end, halfTexel) clamp(page, (begin) - (halfTexel), (end) + (halfTexel))
#else
#define ZIPMAP_STOP(page, begin, end, halfTexel) (page)
#endif
vec4 zipmap_texel(vec2 texel, vec2 size, vec4 level, int pageClass)
{
    vec4 result = vec4(0.0);
    vec2 page = texel * level.xy + level.zw;
    vec2 end = size * level.xy + level.zw;
#if ZIPMAP_SRGB
    result = textureLod(pagesSrgb, ZIPMAP_STOP(page, level.zw, end, pageHalfTexel[PAGE_SRGB].xy), 0.0);
#endif
#if ZIPMAP_HALF
    vec4 high = textureLod(pagesHalf, ZIPMAP_STOP(page, level.zw, end, pageHalfTexel[PAGE_HALF].xy), 0.0);
    result = ZIPMAP_SRGB == 0 || pageClass == 1 ? high : result;
#endif
    return result;
}

// A patch of another kind: kind number k is sampled by ZIPMAP_KIND<k>_SAMPLE(record, st, dstdx, dstdy, lod), with the same
// local st as the zipmap; linear, premultiplied, transparent outside of the patch. Only kinds that are there are compiled;
// number 0 is the zipmap itself, whose patches are layers.
#if defined(ZIPMAP_KIND1_SAMPLE) || defined(ZIPMAP_KIND2_SAMPLE) || defined(ZIPMAP_KIND3_SAMPLE)
#define ZIPMAP_OTHER_KINDS 1
vec4 zipmap_other_kind(vec4 names, vec2 st, vec2 dstdx, vec2 dstdy, vec4 image, inout float lod)
{
    int kind = int(names.y);
    int record = int(names.z);
#ifdef ZIPMAP_KIND1_SAMPLE
    if (kind == 1)
        return ZIPMAP_KIND1_SAMPLE(record, st, dstdx, dstdy, lod);
#endif
#ifdef ZIPMAP_KIND2_SAMPLE
    if (kind == 2)
        return ZIPMAP_KIND2_SAMPLE(record, st, dstdx, dstdy, lod);
#endif
#ifdef ZIPMAP_KIND3_SAMPLE
    if (kind == 3)
        return ZIPMAP_KIND3_SAMPLE(record, st, dstdx, dstdy, lod);
#endif
    return image;
}
#endif

// slot: which texture of the material; st and its derivatives per pixel as the surface gives them.
// Returns linear, premultiplied rgba; lod: mip level at which the nearest layer was seen (negative
// when magnified), patchIndex: that layer's number.
vec4 zipmap_tree_sample(int slot, vec2 st, vec2 dstdx, vec2 dstdy, out float lod, out float patchIndex)
{
    ivec2 leaf = zipmap_leaf(slot, st);
    vec3 position = vec3(st, 1.0);
    vec2 wrap = zipmapWrap[slot].xy;
    vec4 color = vec4(0.0);
    float clear = 1.0;
    int left = leaf.y;
    int next = leaf.x;
    int top = leaf.x;
    float topLod = 0.0;
#if LOOKUP_COUNTS && (ZIPMAP_FILTERED || ZIPMAP_MIXED || defined(ZIPMAP_OTHER_KINDS))
    float topFilter = lookupFilter;
#endif
    do {
        // Search: the next layer that covers st.
        vec4 rowX, rowY, rowW;
        vec3 mapped;
        vec2 texel, dx, dy;
        bool covers;
        int codes;
        int following;
        do {
            rowX = record_fetch(next);
            rowY = record_fetch(next + 1);
            rowW = record_fetch(next + 2);
            mapped = vec3(dot(rowX.xyz, position), dot(rowY.xyz, position), dot(rowW.xyz, position));
            texel = mapped.xy / mapped.z;
            codes = int(rowW.w);
            following = next + 5 + ((codes >> 4) & 15) - (codes & 15);
            vec2 reach = vec2(0.0);
#if ZIPMAP_LEVELS > 1 || ZIPMAP_PROBES || ZIPMAP_FILTERED
            // Exact Jacobian of the projective map: d(xy / w) = (d(xy) - xy / w d(w)) / w.
            dx = (vec2(dot(rowX.xy, dstdx), dot(rowY.xy, dstdx)) - texel * dot(rowW.xy, dstdx)) / mapped.z;
            dy = (vec2(dot(rowX.xy, dstdy), dot(rowY.xy, dstdy)) - texel * dot(rowW.xy, dstdy)) / mapped.z;
#endif
#if ZIPMAP_PROBES || ZIPMAP_FILTERED
            reach = ZIPMAP_REACH * (abs(dx) + abs(dy));
#endif
            bvec2 low = greaterThanEqual(texel, -reach);
            bvec2 high = lessThanEqual(texel, vec2(rowX.w, rowY.w) + reach);
            covers = mapped.z > 0.0 && all(low) && all(high) || left <= 1;
            next = covers ? next : following;
            left = covers ? left : left - 1;
        } while (!covers);

        int record = next;
        bool isRoot = left <= 1;
        next = following;
        left--;
        vec2 size = vec2(rowX.w, rowY.w);
#if ZIPMAP_OUTSIDE
        vec2 wrapped = vec2(zipmap_wrap(texel.x, size.x, wrap.x), zipmap_wrap(texel.y, size.y, wrap.y));
        vec2 place = isRoot ? wrapped : texel;
#else
        vec2 place = clamp(texel, vec2(0.0), size);  // samples of a pixel that is covered in part may stray
#endif
        int finest = codes & 15;
        int coarsest = (codes >> 4) & 15;
        int pageClass = codes >> 8;
        float opacity = 2.0 * (rowW.w - float(codes));
#if LOOKUP_COUNTS || ZIPMAP_FILTERED || ZIPMAP_MIXED || defined(ZIPMAP_OTHER_KINDS)
        vec4 names = record_fetch(record + 3);
#endif
#if LOOKUP_COUNTS
        float accesses = names.y == 0.0 && clear > ZIPMAP_OPAQUE ? 1.0 : 0.0;  // none of a pixel that has left the loop
#endif
#if !ZIPMAP_PLAIN
        vec4 sampled = vec4(0.0);
        float level = 0.0;
#elif ZIPMAP_LEVELS == 1 && !ZIPMAP_PROBES
        vec4 sampled = zipmap_texel(place, size, record_fetch(record + 4), pageClass);
        float level = 0.0;
#else
#if ZIPMAP_PROBES
        Footprint footprint = make_footprint(dx, dy);
#if ZIPMAP_MIXED
        float most = names.w;
#else
        float most = zipmapMaxProbes;
#endif
        float probes = footprint_probes(footprint, most);
        float level = footprint_level(footprint, most);
#else
        float level = isotropic_level(dx, dy);
#endif
        float used = clamp(level, float(finest), float(coarsest));
        int fine = int(used);
        float blend = used - float(fine);
        vec4 fineLevel = record_fetch(record + 4 + fine - finest);
        vec4 coarseLevel = record_fetch(record + 4 + min(fine + 1, coarsest) - finest);
#if ZIPMAP_PROBES
        vec4 sampled = vec4(0.0);
        float weight = 1.0 / probes;
        float along = 0.5 * weight - 0.5;
        do {
            vec2 probe = texel + along * footprint.majorDirection;
#if ZIPMAP_OUTSIDE
            vec2 wrappedProbe = vec2(zipmap_wrap(probe.x, size.x, wrap.x), zipmap_wrap(probe.y, size.y, wrap.y));
            probe = isRoot ? wrappedProbe : probe;
#else
            probe = isRoot ? clamp(probe, vec2(0.0), size) : probe;
#endif
            sampled += mix(zipmap_texel(probe, size, fineLevel, pageClass), zipmap_texel(probe, size, coarseLevel, pageClass), blend);
            along += weight;
        } while (along < 0.5);
        sampled *= weight;
#if LOOKUP_COUNTS
        accesses /= weight;
#endif
#else
        vec4 sampled = mix(zipmap_texel(place, size, fineLevel, pageClass), zipmap_texel(place, size, coarseLevel, pageClass), blend);
#endif
#endif
        LOOKUP_COUNT(accesses * (ZIPMAP_LEVELS > 1 || ZIPMAP_PROBES == 1 ? 8.0 : 4.0));
#if ZIPMAP_FILTERED
        if (int(names.y) == ZIPMAP_FILTERED_IMAGE) {
            Image image = image_open(int(names.z));
            vec2 toUv = vec2(1.0, -1.0) / size;
            LOOKUP_FILTER(image.filterCode);
            sampled = image_filter(image, vec2(0.0, 1.0) + texel * toUv, dx * toUv, dy * toUv, zipmapImageProbes, level);
        }
#endif
#ifdef ZIPMAP_OTHER_KINDS
        sampled = zipmap_other_kind(names, st, dstdx, dstdy, sampled, level);
#endif
        bool first = clear == 1.0 && sampled.a > 0.0;
        top = first ? record : top;
#if LOOKUP_COUNTS && (ZIPMAP_FILTERED || ZIPMAP_MIXED || defined(ZIPMAP_OTHER_KINDS))
        float ofOther = 8.0 * fract(names.y);
        bool tells = int(names.y) == ZIPMAP_FILTERED_IMAGE || ofOther == ZIPMAP_AUTO;
        float ofLayer = tells ? lookupFilter : names.y > 0.0 ? ofOther : names.w > 1.0 ? 1.0 : 0.0;
        topFilter = first ? ofLayer : topFilter;
#endif
        topLod = first ? level : topLod;
        color += (mapped.z > 0.0 ? clear * opacity : 0.0) * sampled;
        clear = 1.0 - color.a;
    } while (left > 0 && clear > ZIPMAP_OPAQUE);
    lod = topLod;
#if LOOKUP_COUNTS && (ZIPMAP_FILTERED || ZIPMAP_MIXED || defined(ZIPMAP_OTHER_KINDS))
    LOOKUP_FILTER(topFilter);
#endif
    patchIndex = record_fetch(top + 3).x;
    return color;
}
#endif
