// Vertices of a mesh to clip space. Positions reach the fragment shader relative to the camera, in the axes of the world,
// so that float32 suffices far from the world's origin. A re-based mesh (deep zoom) arrives in clip space already.
#include "texture_vertex.glsl"
#ifdef REBASED
in vec4 inClipPosition;
uniform mat4 eyeFromClip;       // clip space to world axes around the camera; w is not used
#else
in vec3 inPosition;             // object space, relative to the middle of the mesh
uniform mat4 clipFromObject;
uniform mat4 eyeFromObject;     // object space to world axes around the camera
#endif
in vec3 inNormal;
uniform vec2 clipOffset;        // moves the sample within the pixel
uniform mat3 worldFromNormal;

out vec3 eyePosition;
out vec3 worldNormal;

#ifdef DISPLAY_COLOR
in vec3 inDisplayColor;
out vec3 displayColor;
#endif
#ifdef DISPLAY_OPACITY
in float inDisplayOpacity;
out float displayOpacity;
#endif

#if ST_COUNT > 0
in vec2 inSt0;
out vec2 st0;
#endif
#if ST_COUNT > 1
in vec2 inSt1;
out vec2 st1;
#endif
#if ST_COUNT > 2
in vec2 inSt2;
out vec2 st2;
#endif
#if ST_COUNT > 3
in vec2 inSt3;
out vec2 st3;
#endif

#if CLIPPING_PLANE_COUNT > 0
uniform vec4 clippingPlanes[CLIPPING_PLANE_COUNT];   // around the camera; what is on the negative side is cut away
out float gl_ClipDistance[CLIPPING_PLANE_COUNT];
#endif

void main()
{
#ifdef REBASED
    gl_Position = inClipPosition;
    eyePosition = (eyeFromClip * inClipPosition).xyz;
#else
    gl_Position = clipFromObject * vec4(inPosition, 1.0);
    eyePosition = (eyeFromObject * vec4(inPosition, 1.0)).xyz;
#endif
    pass_texture_constants();
    gl_Position.xy += clipOffset * gl_Position.w;
    worldNormal = worldFromNormal * inNormal;

#ifdef DISPLAY_COLOR
    displayColor = inDisplayColor;
#endif
#ifdef DISPLAY_OPACITY
    displayOpacity = inDisplayOpacity;
#endif
#if ST_COUNT > 0
    st0 = inSt0;
#endif
#if ST_COUNT > 1
    st1 = inSt1;
#endif
#if ST_COUNT > 2
    st2 = inSt2;
#endif
#if ST_COUNT > 3
    st3 = inSt3;
#endif
#if CLIPPING_PLANE_COUNT > 0
    for (int i = 0; i < CLIPPING_PLANE_COUNT; ++i)
        gl_ClipDistance[i] = dot(clippingPlanes[i], vec4(eyePosition, 1.0));
#endif
}
