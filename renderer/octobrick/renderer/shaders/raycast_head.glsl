// Takes one slab's samples along every ray that still needs them, front to back, and adds what it
// finds to the picture, in float.
//
// A work group takes 8x8 pixels, in such an order that the invocations that run in lockstep
// (8 on a CPU: 4x2 pixels; 32 or 64 on a GPU) follow rays close together.

layout(local_size_x = 64) in;

layout(rgba32f, binding = 0) uniform image2D picture;
// By work group: whether any of its rays needs samples of later slabs.
layout(std430, binding = 0) buffer Progress { uint unfinished[]; };

uniform ivec2 picture_size;
uniform int slab_axis;
uniform float slab_low_voxel;       // samples between these planes belong to this slab
uniform float slab_high_voxel;

const float SATURATED = 1.0 - 1.0 / 1024.0;  // what is behind cannot change an 8-bit picture

#include "ray.glsl"
#include "bounds.glsl"
#include "depth.glsl"
