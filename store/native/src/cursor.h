// Reads numbers from bytes of a file that may be damaged: nothing is read beyond the end.

#ifndef OCTOBRICK_STORE_CURSOR_H
#define OCTOBRICK_STORE_CURSOR_H

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <type_traits>

#include "faults.h"

namespace octobrick::store {

class Cursor {
  public:
    explicit Cursor(std::span<const char> bytes) : bytes_(bytes) {}

    std::size_t position() const { return at_; }
    std::size_t remaining() const { return bytes_.size() - at_; }

    // The next bytes, which stay where they are.
    std::span<const char> view(std::uint64_t nbytes) {
        if (nbytes > remaining()) {
            throw Truncated("needs " + std::to_string(nbytes) + " more bytes, has " +
                            std::to_string(remaining()));
        }
        const auto seen = bytes_.subspan(at_, nbytes);
        at_ += nbytes;
        return seen;
    }

    void skip(std::uint64_t nbytes) { view(nbytes); }

    // Files are little endian, as are all machines that this is built for.
    template <class T>
    T take() {
        static_assert(std::is_trivially_copyable_v<T>);
        T value;
        std::memcpy(&value, view(sizeof(T)).data(), sizeof(T));
        return value;
    }

    // Text with its length before it.
    std::string text() {
        const auto characters = view(take<std::uint32_t>());
        return {characters.data(), characters.size()};
    }

  private:
    std::span<const char> bytes_;
    std::size_t at_ = 0;
};

}  // namespace octobrick::store

#endif
