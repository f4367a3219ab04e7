#include "raycast_head.glsl"
#include "slab.glsl"
#include "raycast_body.glsl"
