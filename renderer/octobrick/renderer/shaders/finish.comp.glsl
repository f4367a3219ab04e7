// The picture in 8 bits: over a background, or with straight alpha.

layout(local_size_x = 8, local_size_y = 8) in;

layout(rgba32f, binding = 0) uniform readonly image2D picture;
layout(rgba8, binding = 1) uniform writeonly image2D finished;

uniform ivec2 picture_size;
uniform vec3 background;
uniform bool over_background;

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, picture_size))) return;
    vec4 color = imageLoad(picture, pixel);
    if (over_background)
        color = vec4(color.rgb + (1.0 - color.a) * background, 1.0);
    else
        color.rgb = color.a > 0.0 ? color.rgb / color.a : vec3(0);
    imageStore(finished, pixel, clamp(color, 0.0, 1.0));
}
