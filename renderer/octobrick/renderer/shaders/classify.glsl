// From the values of all channels at a point to the colour of one step, premultiplied.

uniform sampler2D transfer;  // one row a channel: premultiplied colour
uniform float entries_per_stored[CHANNELS];
uniform float entry_of_stored_zero[CHANNELS];

vec4 color_of(int channel, float stored) {
    float entry = stored * entries_per_stored[channel] + entry_of_stored_zero[channel];
    vec2 at = vec2((entry + 0.5) / float(${ENTRIES}), (float(channel) + 0.5) / float(CHANNELS));
    return textureLod(transfer, at, 0.0);
}

#if ${RGB}
// The three channels are red, green and blue; the opacity is that of their luminance (Rec. 709).
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);

uniform vec2 rgb_window_stored;  // stored values of black and of full light

vec4 color_of_rgb(vec3 stored) {
    vec2 window = rgb_window_stored;
    vec3 rgb = clamp((stored - window.x) / max(window.y - window.x, 1e-20), 0.0, 1.0);
    float alpha = color_of(0, dot(stored, LUMINANCE)).a;
    return vec4(rgb * alpha, alpha);
}
#endif

// Several materials in one place: what one lets through, another can still stop. Each has its part
// of the light that is stopped, in any order.
struct Mixture {
    vec4 sum;
    float transparency;
};

const Mixture NOTHING = Mixture(vec4(0), 1.0);

void mix_in(inout Mixture mixture, vec4 color) {
    mixture.sum += color;
    mixture.transparency *= 1.0 - color.a;
}

vec4 color_of_mixture(Mixture mixture) {
    float alpha = 1.0 - mixture.transparency;
    return mixture.sum.a > 0.0 ? vec4(mixture.sum.rgb * (alpha / mixture.sum.a), alpha) : vec4(0);
}
