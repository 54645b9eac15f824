// Data AOVs, each in a float32 target of its own: never blended or averaged. AOV_<NAME> is the target's location.
// Requires surface_textures; MAIN_ST, the varying of the AOV `st`. Provides write_aovs.

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
uniform mat3 cameraFromWorld;    // rotation

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
}
