// From a voxel in the sample type to the stored value 0..1.
#if ${IS_FLOAT}

uniform vec2 value_range;  // values that are stored as 0 and as 1

// In double: max - min may exceed float's range.
float to_stored(float value) {
    precise double low = double(value_range.x);
    precise double width = double(value_range.y) - low;
    return width > 0.0LF ? float((double(value) - low) / width) : 0.0;
}

#else

// Exact: the texture's unsigned normalised format rounds value/highest back to the same integer.
float to_stored(int value) {
    return float(value - (${LOWEST})) / float(${HIGHEST} - (${LOWEST}));
}

#endif
