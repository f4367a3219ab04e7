// How far what is seen lies from the eye's plane, in world units, by pixel.
#if ${DEPTH}

layout(r32f, binding = 1) uniform writeonly image2D depth_picture;

uniform float depth_of_start;       // of the plane that rays start on
uniform float step_world;
uniform vec3 forward_world;         // unit vector into the picture

void put_depth(Ray ray, float steps, ivec2 pixel) {
    float depth = depth_of_start + steps * step_world * dot(ray.direction_world, forward_world);
    imageStore(depth_picture, pixel, vec4(depth));
}

#else
void put_depth(Ray ray, float steps, ivec2 pixel) {}
#endif
