// Gradients on the fly: central differences of interpolated values.

uniform vec3 difference_weight;    // smallest spacing / spacing: differences per world length

// In stored values per smallest spacing.
vec3 difference_at(int channel, vec3 p) {
    return 0.5 * difference_weight * vec3(
        stored_at(channel, p + vec3(1, 0, 0)) - stored_at(channel, p - vec3(1, 0, 0)),
        stored_at(channel, p + vec3(0, 1, 0)) - stored_at(channel, p - vec3(0, 1, 0)),
        stored_at(channel, p + vec3(0, 0, 1)) - stored_at(channel, p - vec3(0, 0, 1)));
}
