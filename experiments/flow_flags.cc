// Flags of a flow that packings have, too, under the same names: apart from
// flow_scene.cc for binaries that have both (`tradeoff`, with those of
// scene.cc).

#include "gflags/gflags.h"

DEFINE_int32(particles, 100, "number of grains n of a random start");
DEFINE_string(input,
              "",
              "extended XYZ file (spheres in a cube) for centres, radii and, "
              "if it has them (velo), velocities, instead of a random start; a "
              "flow's own start.xyz and final.xyz are such");
DEFINE_double(tolerance, 1e-8, "TOL of an implicit step");
