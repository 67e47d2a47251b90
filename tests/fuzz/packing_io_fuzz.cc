// Whatever the bytes, ParsePacking() must return: either one printable line of
// error with its place, or a valid packing that FormatPacking() writes and
// ParsePacking() reads back bit by bit. What ParseFrame() reads is valid and
// has velocities of all its grains or of none.
//
// Built twice: with libFuzzer (GRANOPT_FUZZ, Clang) and, everywhere, into
// replay_test, which runs it over the files of corpus/.

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <string>

#include "granular/packing.h"
#include "granular/packing_io.h"

namespace {

using granopt::DoubleDouble;
using granopt::FormatPacking;
using granopt::FrameExtras;
using granopt::Packing;
using granopt::ParseFrame;
using granopt::ParsePacking;

void Require(bool condition, const char* what, const std::string& detail) {
  if (condition) return;
  std::fprintf(stderr, "packing_io_fuzz: %s\n%s\n", what, detail.c_str());
  std::abort();
}

bool SameBits(double a, double b) {
  return std::memcmp(&a, &b, sizeof(double)) == 0;
}

bool Same(const Packing& a, const Packing& b) {
  const int d = a.dimension();
  if (d != b.dimension() || a.size() != b.size() ||
      a.stiffness.size() != b.stiffness.size() ||
      a.attributes != b.attributes) {
    return false;
  }
  for (int k = 0; k < d; ++k) {
    for (int c = 0; c < d; ++c) {
      if (!SameBits(a.box.edges()(k, c), b.box.edges()(k, c))) return false;
    }
  }
  for (int i = 0; i < a.size(); ++i) {
    for (int k = 0; k < d; ++k) {
      const DoubleDouble x = a.Position(i, k), y = b.Position(i, k);
      if (!SameBits(x.hi, y.hi) || !SameBits(x.lo, y.lo)) return false;
    }
    if (!SameBits(a.radii[i], b.radii[i])) return false;
    if (a.stiffness.size() > 0 && !SameBits(a.stiffness[i], b.stiffness[i])) {
      return false;
    }
    if ((a.species.empty() ? "A" : a.species[i]) !=
        (b.species.empty() ? "A" : b.species[i])) {
      return false;
    }
  }
  return true;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data,
                                      std::size_t size) {
  const std::string text(reinterpret_cast<const char*>(data), size);
  Packing packing, frame;
  FrameExtras extras;
  std::string error;
  const bool is_frame = ParseFrame(text, "input", &frame, &extras, &error);
  if (is_frame) {
    Require(frame.IsValid(&error), "parsed frame is not valid", error);
    Require(extras.velocities.size() == 0 ||
                extras.velocities.cols() == frame.size(),
            "velocities of other grains",
            text);
  }
  if (!ParsePacking(text, "input", &packing, &error)) {
    Require(error.compare(0, 6, "input:") == 0, "no place in the error", error);
    for (const char c : error) {
      Require(c >= 32 && c < 127, "error is not one printable line", error);
    }
    Require(packing.size() == 0, "an error changed the packing", error);
    return 0;
  }
  Require(packing.IsValid(&error), "parsed packing is not valid", error);

  const std::string written = FormatPacking(packing);
  Packing again;
  Require(ParsePacking(written, "written", &again, &error),
          "written packing is refused",
          error + "\n" + written);
  Require(Same(packing, again), "round trip changed the packing", written);
  Require(
      FormatPacking(again) == written, "written twice, not the same", written);

  // A valid packing is one whose images have numbers.
  packing.Wrap();
  Require(packing.IsValid(&error), "wrapped packing is not valid", error);
  return 0;
}
