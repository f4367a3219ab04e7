// What can be wrong with a file; the bindings make Python exceptions of these.

#ifndef OCTOBRICK_STORE_FAULTS_H
#define OCTOBRICK_STORE_FAULTS_H

#include <stdexcept>

namespace octobrick::store {

// The file contradicts itself.
struct Damaged : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The file ends before what it promises.
struct Truncated : std::runtime_error {
    using std::runtime_error::runtime_error;
};

// The file is sound, as far as is known, but of a kind that is not read.
struct Unsupported : std::runtime_error {
    using std::runtime_error::runtime_error;
};

inline void require_sound(bool holds, const char* otherwise) {
    if (!holds) throw Damaged(otherwise);
}

}  // namespace octobrick::store

#endif
