// granopt: packings as extended XYZ.
//
// One frame, as OVITO and ASE read it:
//
//   N
//   Lattice="ax ay az bx by bz cx cy cz"
//   Properties=species:S:1:pos:R:3:radius:R:1
//       pbc="T T F" key=value ...                                  (one line)
//   A x y z radius
//   ...
//
// Columns: pos and radius are required; species, pos_lo:R:3 (the low part of
// the positions, see double_double.h) and stiffness:R:1 are read if present,
// others are skipped. pbc="T T F" means discs in the plane (all z equal, cell
// edges in the plane), "T T T" spheres; without pbc the frame is 2D if all z
// are equal. Other keys (alpha, k, seed, ...) are kept in Packing::attributes;
// quoted text may hold the escapes \" \\ and \n of the format.

#ifndef GRANOPT_GRANULAR_PACKING_IO_H_
#define GRANOPT_GRANULAR_PACKING_IO_H_

#include <string>
#include <vector>

#include "Eigen/Core"
#include "granular/packing.h"

namespace granopt {

// Returns false and one line `name:line: what, and the value` in `error` for
// anything malformed, truncated, non-finite, out of range or not periodic.
bool ParsePacking(const std::string& text,
                  const std::string& name,
                  Packing* packing,
                  std::string* error);
bool ReadPacking(const std::string& path, Packing* packing, std::string* error);

// What a frame of a flow says beyond a packing.
struct FrameExtras {
  SmallVector origin;          // Origin="x y z", the cell's corner; empty: none
  Eigen::MatrixXd velocities;  // velo:R:3, 3 x N; empty: none
};
// As ParsePacking(), and takes pbc="F F F", too: spheres in a box that has no
// images.
bool ParseFrame(const std::string& text,
                const std::string& name,
                Packing* packing,
                FrameExtras* extras,
                std::string* error);

// A column of three numbers a grain, the third 0 in 2D.
struct GrainVectors {
  std::string name;
  const Eigen::MatrixXd* values;  // d x N
};
// %.17g throughout, pos_lo if any low part is not zero; `vectors` behind all
// that ReadPacking() knows, with nine digits.
std::string FormatPacking(const Packing& packing,
                          const std::vector<GrainVectors>& vectors = {});
// Atomic. Refuses what ReadPacking() would not read back: an invalid packing, a
// blank species, an attribute with one of the format's own names.
bool WritePacking(const std::string& path,
                  const Packing& packing,
                  std::string* error);

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_PACKING_IO_H_
