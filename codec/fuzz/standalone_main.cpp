// Fuzzing where there is no libFuzzer: inputs from a seed, by blind changes of a corpus.
//
//     s3dc_fuzzer [-seed=1] [-runs=N] [-max_total_time=SECONDS] [-timeout=SECONDS] [PATH...]
//
// Folders are the corpus; files are run as they are, and nothing else then. The arguments are those
// of libFuzzer. Ends with status 0 after so many runs or seconds (default: 10 s). An input that
// fails, or takes longer than the timeout, is written to crash-input in the current folder, with
// status 1 or more. Run n of a seed is always the same input.

#include <fcntl.h>
#include <sanitizer/common_interface_defs.h>
#include <unistd.h>

#include <chrono>
#include <csignal>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "fuzz.h"

namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMost_nbytes = 4096;  // of an input: as libFuzzer's default

struct Options {
    std::uint64_t seed = 1, runs = 0;
    unsigned seconds = 0, timeout = 20;
    std::vector<Bytes> corpus;
    std::vector<fs::path> files;
};

// ---- What is done when an input fails ----

const Bytes* current = nullptr;  // what the target works on

// Uses nothing but system calls: the heap may be in pieces.
void save_current() {
    if (current == nullptr) return;
    const int file = open("crash-input", O_WRONLY | O_CREAT | O_TRUNC, 0644);
    if (file < 0) return;
    const bool saved = write(file, current->data(), current->size()) >= 0;
    close(file);
    static constexpr char kSaid[] = "The input is in crash-input: give it as the only argument.\n";
    if (saved) (void)!write(STDERR_FILENO, kSaid, sizeof kSaid - 1);
    current = nullptr;
}

void die(int signal) {
    static constexpr char kHangs[] = "An input takes longer than the timeout.\n";
    if (signal == SIGALRM) (void)!write(STDERR_FILENO, kHangs, sizeof kHangs - 1);
    save_current();
    _exit(signal == SIGALRM ? 70 : 77);  // libFuzzer's own
}

void run(const Bytes& input, unsigned timeout) {
    // A copy of exactly this size, of which the sanitiser sees the end.
    const octobrick::fuzz::Exact<std::uint8_t> exact{std::span(input)};
    current = &input;
    alarm(timeout);
    LLVMFuzzerTestOneInput(exact.data(), input.size());
    alarm(0);
    current = nullptr;
}

// ---- Inputs ----

// SplitMix64: any seed will do, and each run has its own.
class Random {
  public:
    explicit Random(std::uint64_t seed) : state_(seed) {}
    std::uint64_t next() {
        std::uint64_t z = state_ += 0x9e3779b97f4a7c15;
        z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9;
        z = (z ^ z >> 27) * 0x94d049bb133111eb;
        return z ^ z >> 31;
    }
    std::size_t below(std::size_t end) { return next() % end; }
    std::uint8_t byte() { return static_cast<std::uint8_t>(next() >> 56); }

  private:
    std::uint64_t state_;
};

void append_random(Bytes& bytes, std::size_t count, Random& random) {
    for (std::size_t i = 0; i < count; ++i) bytes.push_back(random.byte());
}

// A number that counts, offsets and floats have trouble with.
std::uint64_t extreme(Random& random) {
    static constexpr std::uint64_t kFloats[] = {0x7f800000, 0x7fc00000, 0x7f7fffff, 0x00000001,
                                                0x80000000, 0x00800000, 0xff7fffff, 0x3f800000};
    const std::uint64_t power = std::uint64_t{1} << random.below(64);
    switch (random.below(5)) {
        case 0: return power;
        case 1: return power - 1;
        case 2: return ~power + 2 * random.below(2);
        case 3: return random.below(300);
        default: return kFloats[random.below(std::size(kFloats))];
    }
}

// Half of the places are near the front, where headers are.
std::size_t any_place(const Bytes& bytes, Random& random) {
    constexpr std::size_t kHeader_nbytes = 80;
    const bool front = random.below(2) == 0;
    return random.below(front ? std::min(bytes.size(), kHeader_nbytes) : bytes.size());
}

void mutate(Bytes& bytes, const Bytes& other, Random& random) {
    if (bytes.empty()) return append_random(bytes, 1 + random.below(64), random);
    const std::size_t at = any_place(bytes, random);
    const auto place = bytes.begin() + static_cast<std::ptrdiff_t>(at);
    const std::size_t count = 1 + random.below(bytes.size() - at);
    switch (random.below(8)) {
        case 0: bytes[at] ^= static_cast<std::uint8_t>(1u << random.below(8)); break;
        case 1: bytes[at] = random.byte(); break;
        case 2:
        case 3: {
            const std::uint64_t value = extreme(random);
            const std::size_t width = std::size_t{1} << random.below(4);
            // Most fields lie at multiples of their width, not all.
            const std::size_t start = random.below(2) == 0 ? at / width * width : at;
            std::memcpy(&bytes[start], &value, std::min(width, bytes.size() - start));
            break;
        }
        case 4: bytes.resize(at); break;
        case 5: append_random(bytes, 1 + random.below(32), random); break;
        case 6:
            std::fill_n(place, count, random.below(2) == 0 ? std::uint8_t{0} : random.byte());
            break;
        case 7: {  // splice: what follows comes from another code
            bytes.resize(at);
            const std::size_t from = std::min(at, other.size());
            bytes.insert(bytes.end(), other.begin() + static_cast<std::ptrdiff_t>(from),
                         other.end());
            break;
        }
    }
}

Bytes make_input(const Options& options, std::uint64_t number) {
    Random random(options.seed * 0xd6e8feb86659fd93 + number);
    Bytes bytes;
    if (options.corpus.empty() || random.below(4) == 0) {
        append_random(bytes, random.below(std::size_t{1} << random.below(13)), random);
    } else {
        // Many targets take parameters from the first bytes, and then a code.
        static constexpr std::size_t kParameters_nbytes[] = {0, 0, 8, 8};
        append_random(bytes, kParameters_nbytes[random.below(4)], random);
        const Bytes& code = options.corpus[random.below(options.corpus.size())];
        bytes.insert(bytes.end(), code.begin(), code.end());
    }
    static const Bytes kNone;
    // One change gets furthest behind the checks; several find what one cannot.
    const std::size_t changes = random.below(2) == 0 ? 1 : random.below(9);
    for (std::size_t left = changes; left > 0; --left) {
        const std::size_t codes = options.corpus.size();
        mutate(bytes, codes == 0 ? kNone : options.corpus[random.below(codes)], random);
    }
    if (bytes.size() > kMost_nbytes) bytes.resize(kMost_nbytes);
    return bytes;
}

// ---- Arguments ----

Bytes read_file(const fs::path& path) {
    std::ifstream file(path, std::ios::binary);
    if (!file) {
        std::fprintf(stderr, "cannot read %s\n", path.c_str());
        std::exit(2);
    }
    return Bytes(std::istreambuf_iterator<char>(file), {});
}

Options parse(int count, char** arguments) {
    Options options;
    for (int i = 1; i < count; ++i) {
        const std::string argument = arguments[i];
        const std::size_t equals = argument.find('=');
        if (argument[0] == '-' && equals != std::string::npos) {
            const std::string name = argument.substr(1, equals - 1);
            const std::uint64_t value = std::strtoull(&argument[equals + 1], nullptr, 10);
            if (name == "seed")
                options.seed = value;
            else if (name == "runs")
                options.runs = value;
            else if (name == "max_total_time")
                options.seconds = static_cast<unsigned>(value);
            else if (name == "timeout")
                options.timeout = static_cast<unsigned>(value);
            else
                std::exit((std::fprintf(stderr, "unknown: %s\n", argument.c_str()), 2));
        } else if (fs::is_directory(argument)) {
            std::vector<fs::path> paths{fs::directory_iterator(argument), {}};
            std::sort(paths.begin(), paths.end());  // so that a seed means the same everywhere
            for (const fs::path& path : paths) {
                if (fs::is_regular_file(path)) options.corpus.push_back(read_file(path));
            }
        } else {
            options.files.push_back(argument);
        }
    }
    if (options.runs == 0 && options.seconds == 0) options.seconds = 10;
    return options;
}

}  // namespace

int main(int count, char** arguments) {
    const Options options = parse(count, arguments);
    __sanitizer_set_death_callback(save_current);
    std::signal(SIGALRM, die);
    std::signal(SIGABRT, die);
    for (const fs::path& file : options.files) run(read_file(file), options.timeout);
    std::uint64_t runs = options.files.size();
    if (options.files.empty()) {
        const auto end = Clock::now() + std::chrono::seconds(options.seconds);
        for (const Bytes& code : options.corpus) run(code, options.timeout);
        while ((options.runs == 0 || runs < options.runs) &&
               (options.seconds == 0 || Clock::now() < end)) {
            run(make_input(options, runs++), options.timeout);
        }
    }
    std::printf("%llu runs, seed %llu, corpus of %zu\n", static_cast<unsigned long long>(runs),
                static_cast<unsigned long long>(options.seed), options.corpus.size());
}
