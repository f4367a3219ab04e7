#include "zerobit_analysis.h"

#include <algorithm>
#include <bit>
#include <functional>
#include <limits>
#include <map>
#include <numeric>

#include "faults.h"
#include "guarded_parallel.h"
#include "haar.h"

namespace octobrick::codec::detail {
namespace {

// Signed sums of one cell: [0] the average, [1 + 7i + (j - 1)] detail j of node i. Those of level
// 0 and the average are 64 times the coefficient, those of level 1 are 8 times.
struct CellSums {
    std::array<double, kCells> of[3];
};

constexpr unsigned first_of_node(unsigned node) { return 1 + kNodeDetails * node; }
constexpr double divisor(unsigned coefficient) {
    return coefficient < first_of_node(1) ? 64.0 : 8.0;
}

// Where a cell lies, and whether it takes part.
struct CellPlace {
    Zyx cell;
    bool wanted;
};

CellPlace place(const Analysis& a, std::size_t block, unsigned number) {
    const Zyx at = {block / (a.grid.y * a.grid.x), block / a.grid.x % a.grid.y, block % a.grid.x};
    const Zyx cell = {4 * at.z + number / 16, 4 * at.y + number / 4 % 4, 4 * at.x + number % 4};
    const bool inside = cell.z < a.cells.z && cell.y < a.cells.y && cell.x < a.cells.x;
    return {cell, inside && (a.wanted.empty() ||
                             a.wanted[(cell.z * a.cells.y + cell.y) * a.cells.x + cell.x] != 0)};
}

// The 64 voxels of a cell in each channel, ordered by the 2^3 group that they belong to; those
// outside of the volume repeat its last.
template <class T>
void gather(const Analysis& a, Zyx cell, double (&groups)[3][8][8]) {
    const Zyx shape = a.volume.shape;
    const unsigned channels = a.volume.channels;
    for (unsigned z = 0; z < kCell; ++z) {
        for (unsigned y = 0; y < kCell; ++y) {
            const std::size_t row = std::min(kCell * cell.z + z, shape.z - 1) * shape.y +
                                    std::min(kCell * cell.y + y, shape.y - 1);
            for (unsigned x = 0; x < kCell; ++x) {
                const std::size_t at = row * shape.x + std::min(kCell * cell.x + x, shape.x - 1);
                const std::byte* from = a.volume.origin + at * channels * sizeof(T);
                const unsigned group = 4 * (z / 2) + 2 * (y / 2) + x / 2;
                const unsigned member = 4 * (z % 2) + 2 * (y % 2) + x % 2;
                for (unsigned c = 0; c < channels; ++c) {
                    groups[c][group][member] = static_cast<double>(load<T>(from + c * sizeof(T)));
                }
            }
        }
    }
}

void gather(const Analysis& a, Zyx cell, double (&groups)[3][8][8]) {
    with_sample_type(a.volume.type, [&](auto zero) {
        gather<decltype(zero)>(a, cell, groups);
        return 0;
    });
}

void transform(const Analysis& a, Zyx cell, CellSums& sums) {
    double groups[3][8][8];
    gather(a, cell, groups);
    for (unsigned c = 0; c < a.volume.channels; ++c) {
        auto& out = sums.of[c];
        double averages[8], node[8];
        for (unsigned i = 0; i < 8; ++i) {
            haar_forward_sums(groups[c][i], node);
            averages[i] = node[0];
            std::copy(node + 1, node + 8, &out[first_of_node(i + 1)]);
        }
        haar_forward_sums(averages, node);
        std::copy(node, node + 8, out.data());
    }
}

// How coefficients become numbers that a codeword can have, and which of them matter.
struct Ranking {
    explicit Ranking(const Analysis& a)
        : channels(a.volume.channels),
          type(a.volume.type),
          background(a.background),
          level1(a.settings.orthonormal ? 8.0 : 64.0) {}

    // A coefficient in the type of its codewords; averages are not clamped, as none can leave it.
    double rounded(double sum, unsigned coefficient) const {
        const double value = sum / divisor(coefficient);
        if (type == SampleType::f32) return static_cast<double>(static_cast<float>(value));
        const double half_up = std::floor(value + 0.5);
        if (coefficient == 0) return half_up;
        const double limit = sample_nbytes(type) == 1 ? 128.0 : 32768.0;
        return std::clamp(half_up, -limit, limit - 1);
    }

    ZerobitColour rounded(const CellSums& sums, unsigned coefficient) const {
        ZerobitColour colour{};
        for (unsigned c = 0; c < channels; ++c) {
            colour[c] = rounded(sums.of[c][coefficient], coefficient) + 0.0;  // no -0
        }
        return colour;
    }

    // Whether rounded(sum) is 0, or for the average the background; `above` is what it is more.
    bool rounds_to_null(double sum, double above, unsigned coefficient, unsigned channel) const {
        if (type == SampleType::f32) {
            return rounded(sum, coefficient) == (coefficient == 0 ? background[channel] : 0.0);
        }
        const double half = divisor(coefficient) / 2;
        return above >= -half && above < half;
    }

    // 0 for a coefficient that rounds to null; else its rank, which is positive.
    double rank(const CellSums& sums, unsigned coefficient) const {
        double squares = 0;
        bool null = true;
        for (unsigned c = 0; c < channels; ++c) {
            double sum = sums.of[c][coefficient];
            if (coefficient == 0) sum -= 64 * background[c];
            null = null && rounds_to_null(sums.of[c][coefficient], sum, coefficient, c);
            squares += sum * sum;
        }
        if (null) return 0;
        return coefficient < first_of_node(1) ? squares : level1 * squares;
    }

    // A rank as the norm of a detail of level 1.
    double norm(double rank) const { return std::sqrt(rank / level1) / 8; }

    unsigned channels;
    SampleType type;
    ZerobitColour background;
    double level1;  // the weight of a squared sum of level 1; that of level 0 is 1
};

// Calls f(number, sums) for every wanted cell of a unit block.
template <class F>
void for_each_cell(const Analysis& a, std::size_t block, const F& f) {
    CellSums sums;
    for (unsigned number = 0; number < kCells; ++number) {
        const CellPlace at = place(a, block, number);
        if (at.wanted) {
            transform(a, at.cell, sums);
            f(number, sums);
        }
    }
}

// The ranks of a unit block's coefficients that are not null and compete.
std::vector<double> ranks_of(const Analysis& a, std::size_t block) {
    const Ranking ranking(a);
    std::vector<double> ranks;
    for_each_cell(a, block, [&](unsigned, const CellSums& sums) {
        for (unsigned k = a.settings.count_averages ? 0 : 1; k < kCells; ++k) {
            if (const double rank = ranking.rank(sums, k); rank > 0) ranks.push_back(rank);
        }
    });
    return ranks;
}

// The part of a budget for `of` of `all` coefficients, no more than there are.
std::size_t share(double budget, std::size_t of, std::size_t all) {
    if (of == 0) return 0;
    const double part = budget * static_cast<double>(of) / static_cast<double>(all);
    return std::min(of, static_cast<std::size_t>(std::floor(part + 0.5)));
}

// The count-th greatest; infinity for none.
double nth_greatest(std::vector<double>& ranks, std::size_t count) {
    if (count == 0) return std::numeric_limits<double>::infinity();
    const auto nth = ranks.begin() + static_cast<std::ptrdiff_t>(count - 1);
    std::nth_element(ranks.begin(), nth, ranks.end(), std::greater<>());
    return *nth;
}

// The threshold of all blocks together: the rank of the one that just lives. Positive doubles are
// ordered like the integers of their bits, of which the upper 16 are found first; then only ranks
// that begin with these are held.
double global_threshold(const Analysis& a, double budget, unsigned threads) {
    constexpr unsigned kShift = 48;
    const auto leading = [](double rank) { return std::bit_cast<std::uint64_t>(rank) >> kShift; };
    std::vector<std::vector<std::size_t>> counts(threads, std::vector<std::size_t>(1u << 16));
    guarded_parallel_for(a.blocks(), threads, [&](std::size_t block, unsigned worker) {
        for (const double rank : ranks_of(a, block)) ++counts[worker][leading(rank)];
    });
    std::size_t alive = 0;
    for (const auto& of_worker : counts) {
        alive = std::accumulate(of_worker.begin(), of_worker.end(), alive);
    }
    std::size_t count = share(budget, alive, alive);
    if (count == 0) return std::numeric_limits<double>::infinity();
    std::size_t digit = counts[0].size();
    for (std::size_t here = 0;; count -= here) {
        --digit;
        here = 0;
        for (const auto& of_worker : counts) here += of_worker[digit];
        if (here >= count) break;
    }
    std::vector<std::vector<double>> found(threads);
    guarded_parallel_for(a.blocks(), threads, [&](std::size_t block, unsigned worker) {
        for (const double rank : ranks_of(a, block)) {
            if (leading(rank) == digit) found[worker].push_back(rank);
        }
    });
    for (unsigned worker = 1; worker < threads; ++worker) {
        found[0].insert(found[0].end(), found[worker].begin(), found[worker].end());
    }
    return nth_greatest(found[0], count);
}

// What one unit block keeps: all that rank at least as high as the threshold.
KeptBlock keep_block(const Analysis& a, std::size_t block, double threshold) {
    const Ranking ranking(a);
    KeptBlock kept;
    double dropped = 0;
    for_each_cell(a, block, [&](unsigned number, const CellSums& sums) {
        KeptCell cell{static_cast<std::uint8_t>(number), {}};
        bool any = false;
        for (unsigned k = 1; k < kCells; ++k) {
            const double rank = ranking.rank(sums, k);
            if (rank > 0 && rank >= threshold) {
                const unsigned node = (k - 1) / kNodeDetails, bit = (k - 1) % kNodeDetails;
                cell.maps[node] = static_cast<std::uint8_t>(cell.maps[node] | 1u << bit);
                kept.details.push_back(ranking.rounded(sums, k));
                any = true;
            } else {
                dropped = std::max(dropped, rank);
            }
        }
        const bool average_lives = !a.settings.count_averages || ranking.rank(sums, 0) >= threshold;
        const ZerobitColour average = average_lives ? ranking.rounded(sums, 0) : a.background;
        if (any || average != a.background) {
            kept.cells.push_back(cell);
            kept.averages.push_back(average);
        }
    });
    kept.dropped = ranking.norm(dropped);
    return kept;
}

// ---- The survey -------------------------------------------------------------------------------

struct BlockSurvey {
    double least = std::numeric_limits<double>::infinity();
    double greatest = -std::numeric_limits<double>::infinity();
    std::size_t wanted_cells = 0;
    std::map<ZerobitColour, std::size_t> constant_cells;  // by their colour
};

BlockSurvey survey_block(const Analysis& a, std::size_t block,
                         FirstFaultOf<ZerobitOutcome>& fault) {
    BlockSurvey found;
    double groups[3][8][8];
    for (unsigned number = 0; number < kCells; ++number) {
        const CellPlace at = place(a, block, number);
        if (!at.wanted) continue;
        ++found.wanted_cells;
        gather(a, at.cell, groups);
        ZerobitColour colour{};
        bool constant = true;
        for (unsigned c = 0; c < a.volume.channels; ++c) {
            colour[c] = groups[c][0][0] + 0.0;  // no -0
            for (unsigned k = 0; k < kCells; ++k) {
                const double value = groups[c][k / 8][k % 8];
                constant = constant && value == colour[c];
                if (!std::isfinite(value)) {
                    const unsigned i = k / 8, j = k % 8;
                    const Zyx voxel = {
                        std::min(kCell * at.cell.z + 2 * (i / 4) + j / 4, a.volume.shape.z - 1),
                        std::min(kCell * at.cell.y + 2 * (i / 2 % 2) + j / 2 % 2,
                                 a.volume.shape.y - 1),
                        std::min(kCell * at.cell.x + 2 * (i % 2) + j % 2, a.volume.shape.x - 1)};
                    fault.report(block, {ZerobitStatus::not_finite, voxel, value, 0});
                    return found;
                }
                found.least = std::min(found.least, value);
                found.greatest = std::max(found.greatest, value);
            }
        }
        if (constant) ++found.constant_cells[colour];
    }
    return found;
}

}  // namespace

ZerobitOutcome survey(Analysis& a, unsigned threads) {
    a.cells = ceil_div(a.volume.shape, kCell);
    a.grid = ceil_div(a.volume.shape, kBlock);
    std::vector<BlockSurvey> found(a.blocks());
    FirstFaultOf<ZerobitOutcome> fault;
    guarded_parallel_for(a.blocks(), threads, [&](std::size_t block, unsigned) {
        found[block] = survey_block(a, block, fault);
    });
    if (fault.outcome().status != ZerobitStatus::ok) return fault.outcome();

    BlockSurvey all;
    for (const BlockSurvey& block : found) {
        all.least = std::min(all.least, block.least);
        all.greatest = std::max(all.greatest, block.greatest);
        all.wanted_cells += block.wanted_cells;
        for (const auto& [colour, count] : block.constant_cells) {
            all.constant_cells[colour] += count;
        }
    }
    a.wanted_cells = all.wanted_cells;
    if (a.settings.background) {
        a.background = *a.settings.background;
    } else {
        a.background = {};
        std::size_t most = 0;
        for (const auto& [colour, count] : all.constant_cells) {
            if (count > most) {
                a.background = colour;
                most = count;
            }
        }
    }
    a.least = a.wanted_cells != 0 ? all.least + 0.0 : a.background[0];
    a.greatest = a.wanted_cells != 0 ? all.greatest + 0.0 : a.background[0];
    return {};
}

std::vector<KeptBlock> keep_significant(const Analysis& a, unsigned threads) {
    const double budget = static_cast<double>(kCells * a.wanted_cells) * a.settings.ratio;
    std::vector<std::size_t> alive(a.blocks());
    std::size_t all_alive = 0;
    double threshold = 0;
    if (a.settings.global) {
        threshold = global_threshold(a, budget, threads);
    } else {
        guarded_parallel_for(a.blocks(), threads, [&](std::size_t block, unsigned) {
            alive[block] = ranks_of(a, block).size();
        });
        all_alive = std::accumulate(alive.begin(), alive.end(), std::size_t{0});
    }
    std::vector<KeptBlock> kept(a.blocks());
    guarded_parallel_for(a.blocks(), threads, [&](std::size_t block, unsigned) {
        double own = threshold;
        if (!a.settings.global) {
            std::vector<double> ranks = ranks_of(a, block);
            own = nth_greatest(ranks, share(budget, alive[block], all_alive));
        }
        kept[block] = keep_block(a, block, own);
    });
    return kept;
}

}  // namespace octobrick::codec::detail
