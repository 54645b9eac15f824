// Wrap modes of textures, and a position split into a whole cell and what is left of it, which keeps its digits.
// Provides WRAP_CLAMP ..., wrap_coordinate, wrap_locate. Modes are numbered as fexel/textures/image_view.py has them.
#define WRAP_CLAMP 0
#define WRAP_REPEAT 1
#define WRAP_MIRROR 2
#define WRAP_BLACK 3

// A coordinate of which [0, 1] is the texture; where mode is black it stays what it is.
float wrap_coordinate(float x, int mode)
{
    float repeated = x - floor(x);
    float mirrored = abs(x - 2.0 * floor(0.5 * x + 0.5));
    return mode == WRAP_REPEAT ? repeated : mode == WRAP_MIRROR ? mirrored : mode == WRAP_CLAMP ? clamp(x, 0.0, 1.0) : x;
}

// Along one axis: (cell, place in it in [0, 1], direction). relative + base is a position in cells, `size` of which are the
// texture; direction is that of the wrapped position along the position: 1, -1 where mirrored, 0 where clamped or black.
vec3 wrap_locate(float relative, float base, float size, int mode)
{
    float whole = floor(relative);
    float cell = base + whole;
    float inside = relative - whole;
    float period = floor(cell / size);
    float repeated = clamp(cell - size * period, 0.0, size - 1.0);  // rounding may leave it at size
    bool flips = mode == WRAP_MIRROR && mod(period, 2.0) == 1.0;
    bool stops = (mode == WRAP_CLAMP || mode == WRAP_BLACK) && period != 0.0;
    vec3 wrapped = flips ? vec3(size - 1.0 - repeated, 1.0 - inside, -1.0) : vec3(repeated, inside, 1.0);
    return stops ? vec3(period < 0.0 ? 0.0 : size - 1.0, period < 0.0 ? 0.0 : 1.0, 0.0) : wrapped;
}
