// Packings that are relaxed over all shapes of their cell, next to jamming.

#include <cmath>
#include <memory>
#include <string>

#include "granular/constant_stress.h"
#include "granular/linear_response.h"
#include "gtest/gtest.h"
#include "solvers/registry.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

ElasticResponse ResponseOf(const Packing& packing) {
  return ComputeElasticResponse(packing, ContactEnergyOptions());
}

// Compressed in steps towards zero pressure, with every strain of the cell or
// the isotropic one only.
Relaxation AtPressure(const Packing& start,
                      double pressure,
                      const std::vector<SmallMatrix>& strains) {
  std::string error;
  const auto solver = CreateSolver("auto|newton", &error);
  Packing packing = start;
  ConstantStressResult result;
  for (double p = 1e-2; p > 0.99 * pressure; p *= 0.1) {
    ConstantStressOptions options;
    options.solve.relative_tolerance = 1e-11;
    options.pressure = p;
    options.strains = strains;
    EXPECT_TRUE(RelaxAtStress(packing, options, *solver, &result, &error))
        << error;
    EXPECT_TRUE(result.converged) << p;
    packing = result.relaxation.packing;
  }
  return result.relaxation;
}

// d N' - d + 1 contacts hold a packing of a given volume; that its cell has
// d (d + 1) / 2 - 1 more freedoms takes as many contacts more: in 2D N_c >=
// 2 N' + 1. It resists every shear, which others need not.
TEST(ShearStabilized, HasContactsForItsCellAndResistsEveryShear) {
  for (const int d : {2, 3}) {
    int negative = 0;
    const int seeds = d == 2 ? 6 : 2;
    for (int seed = 1; seed <= seeds; ++seed) {
      const Packing start =
          RandomPacking(d, 64, d == 2 ? 0.9 : 0.7, static_cast<unsigned>(seed));
      const Relaxation stable = AtPressure(start, 1e-6, AllStrains(d));
      const Observables& o = stable.observables;
      const int shears = d * (d + 1) / 2 - 1;
      ASSERT_GT(o.rigid_grains, 32);
      EXPECT_GE(o.rigid_contacts, o.isostatic_contacts + shears)
          << d << " " << seed;
      if (d == 2) {
        EXPECT_GE(o.rigid_contacts, 2 * o.rigid_grains + 1);
      }
      EXPECT_LE(o.stress_parts.deviatoric, 1e-9 * o.pressure);
      const ElasticResponse response = ResponseOf(stable.packing);
      ASSERT_TRUE(response.found) << response.message;
      EXPECT_GT(response.shear_principal.minCoeff(), 0.0) << d << " " << seed;

      const Relaxation plain = AtPressure(start, 1e-6, IsotropicStrain(d));
      EXPECT_GE(plain.observables.rigid_contacts,
                plain.observables.isostatic_contacts);
      const ElasticResponse other = ResponseOf(plain.packing);
      if (other.found && other.shear_principal.minCoeff() < 0.0) ++negative;
    }
    // Of compressed ones some do not.
    if (d == 2) {
      EXPECT_GT(negative, 0);
    }
  }
}

}  // namespace
}  // namespace granopt
