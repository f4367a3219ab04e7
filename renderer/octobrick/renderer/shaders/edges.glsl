// Opacity by the magnitude of the gradient: borders between materials rather than what is in them.

uniform vec2 edge_stored;  // magnitudes (stored values per smallest spacing) of opacity 0 and 1

float edge_at(int channel, vec3 p) {
    float magnitude = length(difference_at(channel, p));
    return clamp((magnitude - edge_stored.x) / (edge_stored.y - edge_stored.x), 0.0, 1.0);
}
