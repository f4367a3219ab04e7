// Whether the tree of a grid in a file is built as its reader in OpenVDB will expect.

#ifndef OCTOBRICK_STORE_VDB_CHECK_H
#define OCTOBRICK_STORE_VDB_CHECK_H

#include <cstddef>
#include <cstdint>
#include <span>

namespace octobrick::store {

// What the check must know of the values of a tree of nodes of 32³, 16³ and 8³.
struct VdbValues {
    std::size_t nbytes = 0;         // in memory
    std::size_t stored_nbytes = 0;  // in nodes in the file: less where halves are stored
    bool is_bool = false;
    std::uint32_t compression = 0;
};

// Walks the tree without decompressing it, in time linear in its bytes. OpenVDB's readers believe
// counts and sizes and would write beyond their buffers; what passes here is safe for them, and
// needs at most some 32 times the memory of its bytes.
//
// Returns the number of leaves. Throws Truncated or Damaged.
std::uint64_t check_tree(std::span<const char> tree, const VdbValues& values);

}  // namespace octobrick::store

#endif
