#include "raycast_head.glsl"
#include "direct.glsl"
#include "raycast_body.glsl"
