// Makes premultiplied colours of the statistics that march_projection.glsl gathered.

layout(local_size_x = 8, local_size_y = 8) in;

layout(rgba32f, binding = 0) uniform image2D picture;

uniform ivec2 picture_size;
uniform vec3 volume_voxels;

const int CHANNELS = ${CHANNELS};

#include "ray.glsl"
#include "bounds.glsl"
#include "classify.glsl"

void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(pixel, picture_size))) return;
    vec4 values = imageLoad(picture, pixel);
    Span span = span_of(ray_of_pixel(pixel), volume_voxels);
    // No sample was taken: the statistics are what they began with.
    bool nothing = span.samples.x >= span.samples.y || values.r < 0.0 || values.r > 1.5;
#if ${STATISTIC} == 2
    nothing = span.samples.x >= span.samples.y;
    values /= float(max(span.samples.y - span.samples.x, 1));
#endif
    vec4 color = vec4(0);
    if (!nothing) {
#if ${RGB}
        color = color_of_rgb(values.rgb);
#else
        Mixture mixture = NOTHING;
        for (int channel = 0; channel < CHANNELS; ++channel)
            mix_in(mixture, color_of(channel, values[channel]));
        color = color_of_mixture(mixture);
#endif
    }
    imageStore(picture, pixel, color);
}
