// Data AOVs, each in a float32 target of its own: never blended or averaged. AOV_<NAME> is the target's location.
// Requires surface_textures, surface_normal, decision, common_footprint; MAIN_ST, the varying of the AOV `st`, which
// exists where ST_COUNT is not 0. Provides measure_aovs, write_aovs.
#include "common_footprint.glsl"

#ifdef AOV_PRIMID
uniform float primId;
layout(location = AOV_PRIMID) out float outPrimId;
#endif
#ifdef AOV_DEPTH
layout(location = AOV_DEPTH) out float outDepth;                  // window depth, [0, 1]
#endif
#ifdef AOV_CAMERADEPTH
layout(location = AOV_CAMERADEPTH) out float outCameraDepth;      // distance along the view direction, world units
#endif
#ifdef AOV_NORMAL
layout(location = AOV_NORMAL) out vec4 outNormal;                 // world axes
#endif
#ifdef AOV_NEYE
layout(location = AOV_NEYE) out vec4 outNeye;                     // camera axes
#endif
#ifdef AOV_POSITION
layout(location = AOV_POSITION) out vec4 outPosition;             // world units, relative to the camera
#endif
#ifdef AOV_ST
uniform vec3 stFrame;                                             // origin and 1 / scale of the local st
layout(location = AOV_ST) out vec2 outSt;
#endif
#ifdef AOV_LOD
layout(location = AOV_LOD) out float outLod;
#endif
#ifdef AOV_PATCH
layout(location = AOV_PATCH) out float outPatch;
#endif
#ifdef AOV_FOOTPRINT
uniform vec4 mainTexels[3];      // from (local st, 1) to texels of the main texture's base image, t up: x w, y w, w
vec3 footprint = vec3(0.0);
layout(location = AOV_FOOTPRINT) out vec4 outFootprint;           // texels, texels, radians from +s towards +t
#endif
#ifdef AOV_FETCHES
layout(location = AOV_FETCHES) out float outFetches;              // texels
#endif
#ifdef AOV_FILTER
layout(location = AOV_FILTER) out float outFilter;                // place in FILTERS of fexel/filters/__init__.py
#endif
#ifdef AOV_DECISION
vec3 decision = vec3(0.0);
layout(location = AOV_DECISION) out vec4 outDecision;
#endif
uniform mat3 cameraFromWorld;    // rotation

#ifdef AOV_FOOTPRINT
// Axes and direction of the ellipse that st makes of a pixel, of the map to texels linearised at st.
vec3 measured_footprint(vec2 st, vec2 dstdx, vec2 dstdy)
{
    vec3 place = vec3(st, 1.0);
    float w = dot(mainTexels[2].xyz, place);
    vec2 texel = vec2(dot(mainTexels[0].xyz, place), dot(mainTexels[1].xyz, place)) / w;
    vec2 dx = vec2(dot(mainTexels[0].xy, dstdx), dot(mainTexels[1].xy, dstdx)) - texel * dot(mainTexels[2].xy, dstdx);
    vec2 dy = vec2(dot(mainTexels[0].xy, dstdy), dot(mainTexels[1].xy, dstdy)) - texel * dot(mainTexels[2].xy, dstdy);
    Footprint f = make_footprint(dx / w, dy / w);
    float angle = atan(f.majorDirection.y, f.majorDirection.x);
    angle += angle < 0.0 ? 3.14159265 : 0.0;
    // Below 1e-12 texels st is constant; beyond the horizon of a projective map there is no texture.
    bool isThere = w > 0.0 && f.majorAxis > 1e-12;
    return isThere ? vec3(f.majorAxis, f.minorAxis, angle < 3.14159265 ? angle : 0.0) : vec3(0.0);
}
#endif

// What takes derivatives: before any branch or discard.
void measure_aovs(vec3 position)
{
#if defined(AOV_FOOTPRINT) && TEXTURE_COUNT > 0
    footprint = measured_footprint(MAIN_ST, dFdx(MAIN_ST), dFdy(MAIN_ST));
#endif
#if defined(AOV_DECISION) && ST_COUNT > 0
    vec3 facet = safe_normalize(cross(dFdx(position), dFdy(position)), vec3(0.0, 0.0, 1.0));
    vec3 toCamera = viewDirection.w > 0.5 ? safe_normalize(-position, facet) : viewDirection.xyz;
#if (TEXTURE_ATTENUATED & 1) != 0
    float intensity = texture_remains(MAIN_TEXTURE);
#else
    float intensity = 1.0;
#endif
    decision = decision_color(toCamera, tangent_frame(facet, position, MAIN_ST), intensity);
#endif
}

void write_aovs(vec3 normal, vec3 position)
{
#ifdef AOV_PRIMID
    outPrimId = primId;
#endif
#ifdef AOV_DEPTH
    outDepth = gl_FragCoord.z;
#endif
#ifdef AOV_CAMERADEPTH
    outCameraDepth = -(cameraFromWorld * position).z;
#endif
#ifdef AOV_NORMAL
    outNormal = vec4(normal, 0.0);
#endif
#ifdef AOV_NEYE
    outNeye = vec4(cameraFromWorld * normal, 0.0);
#endif
#ifdef AOV_POSITION
    outPosition = vec4(position, 0.0);
#endif
#ifdef AOV_ST
#if ST_COUNT > 0
    outSt = stFrame.xy + MAIN_ST * stFrame.z;
#else
    outSt = vec2(0.0);
#endif
#endif
#ifdef AOV_LOD
    outLod = textureLod0;
#endif
#ifdef AOV_PATCH
    outPatch = texturePatch;
#endif
#ifdef AOV_FOOTPRINT
    outFootprint = vec4(footprint, 0.0);
#endif
#ifdef AOV_FETCHES
    outFetches = floor(textureFetches + 0.5);
#endif
#ifdef AOV_FILTER
    outFilter = textureFilter;
#endif
#ifdef AOV_DECISION
    outDecision = vec4(decision, 0.0);
#endif
}
