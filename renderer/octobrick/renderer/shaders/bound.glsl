// Error bounds in the units of the deblocking filter: values of integers, and of float32 parts of
// the volume's range.
#if ${IS_FLOAT}
uniform vec2 value_range;

float filter_bound(float bound) {
    double width = double(value_range.y) - double(value_range.x);
    return width > 0.0LF ? float(double(bound) / width) : 0.0;
}
#else
float filter_bound(float bound) { return bound; }
#endif
