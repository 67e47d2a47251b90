#include "granular/observables.h"

#include <cmath>
#include <string>
#include <utility>
#include <vector>

#include "Eigen/Geometry"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

// ---- states made elsewhere

struct KnownState {
  const char* file;
  double energy, energy_digit;  // as printed, and one unit of the last digit
  double pressure, pressure_digit;  // 0: not printed
  int rigid_grains, rigid_contacts;
};

// tests/data/README.md.
const KnownState kKnownStates[] = {
    {"n256_phi0.8438_a2_relaxed.xyz",
     3.25091e-06,
     1e-11,
     1.57304e-3,
     1e-8,
     254,
     531},
    {"n256_phi0.8438_a2.5_relaxed.xyz",
     5.26842e-09,
     1e-14,
     6.371e-6,
     1e-9,
     248,
     508},
    {"n1024_a2_p1e-04.xyz", 0.0, 0.0, 0.0, 0.0, 985, 1994},
    {"n1024_a2_p1e-08.xyz", 0.0, 0.0, 0.0, 0.0, 976, 1952},
};

TEST(Observables, StatesMadeElsewhereHaveTheirPrintedNumbers) {
  for (const KnownState& known : kKnownStates) {
    SCOPED_TRACE(known.file);
    const Packing packing = ReadData(known.file);
    const double alpha = std::stod(packing.attributes.at("alpha"));
    const Observables o = MeasureAtRest(packing, alpha);
    // Printed digits: half a unit of the last one.
    if (known.energy > 0.0) {
      EXPECT_NEAR(o.energy, known.energy, 0.5001 * known.energy_digit);
      EXPECT_NEAR(o.pressure, known.pressure, 0.5001 * known.pressure_digit);
    }
    EXPECT_EQ(o.grains, packing.size());
    EXPECT_EQ(o.rigid_grains, known.rigid_grains);
    EXPECT_EQ(o.rigid_contacts, known.rigid_contacts);
    EXPECT_EQ(o.rattlers, packing.size() - known.rigid_grains);
    EXPECT_EQ(o.coordination, 2.0 * known.rigid_contacts / known.rigid_grains);
    EXPECT_EQ(o.isostatic_contacts, 2 * known.rigid_grains - 1);
    // A rigid packing has at least that many, (sec. 4).
    EXPECT_GE(o.rigid_contacts, o.isostatic_contacts);
    EXPECT_NEAR(
        o.packing_fraction, std::stod(packing.attributes.at("phi")), 1e-13);
    int rattlers = 0;
    for (const bool is_rattler : o.is_rattler) rattlers += is_rattler;
    EXPECT_EQ(rattlers, o.rattlers);
    EXPECT_GT(o.smallest_force, 0.0);
    EXPECT_LT(o.smallest_force, o.mean_force);
  }
}

TEST(Observables, DecompressedStatesSitJustUnderTheirPressure) {
  for (const auto& [file, pressure] :
       {std::make_pair("n1024_a2_p1e-04.xyz", 1e-4),
        std::make_pair("n1024_a2_p1e-08.xyz", 1e-8)}) {
    const Observables o = MeasureAtRest(ReadData(file), 2.0);
    EXPECT_LT(o.pressure, pressure);
    EXPECT_GT(o.pressure, 0.5 * pressure);
  }
  // The residual promised is about 1e-9 mean forces.
  EXPECT_LT(
      MeasureAtRest(ReadData("n1024_a2_p1e-04.xyz"), 2.0).relative_residual,
      1e-8);
  // At p = 1e-8 the packing is isostatic but for the one contact that carries
  // the pressure.
  const Observables o = MeasureAtRest(ReadData("n1024_a2_p1e-08.xyz"), 2.0);
  EXPECT_EQ(o.rigid_contacts, o.isostatic_contacts + 1);
}

TEST(Observables, ResidualAndMeansAreThoseOfTheGradient) {
  for (const int d : {2, 3}) {
    const Packing packing = RandomPacking(d, 50, 0.9, 1);
    const auto energy = MakeEnergy(packing, 2.5);
    const Evaluation e = Evaluate(*energy);
    const Observables o = MeasureAtRest(packing, 2.5);
    EXPECT_NEAR(o.max_residual, MaxAbs(e.gradient), 1e-14 * o.mean_force);
    EXPECT_NEAR(
        o.relative_residual * o.mean_force / o.max_residual, 1.0, 1e-14);
    EXPECT_NEAR(o.mean_force / e.scales.gradient, 1.0, 1e-14);
    EXPECT_NEAR(o.mean_overlap / (1.5 * e.scales.length), 1.0, 1e-14);
    EXPECT_EQ(o.energy, e.energy);
  }
}

// ---- lattices

// Hexagonal: three bonds a grain, sum n (x) n = 3/2, so that F = 2 v (3/2) N /
// V = 3 phi; fcc: six bonds, sum n (x) n = 2, F = 4 phi. The stress is p.
TEST(Observables, LatticesHaveIsotropicFabricAndStress) {
  for (const double alpha : {2.0, 2.5}) {
    const double a = 0.7;
    const double delta = 0.05;
    const Packing hexagonal =
        BravaisLattice(HexagonalCell(a), {4, 3}, 0.5 * (a + delta));
    const Packing fcc =
        BravaisLattice(FccCell(a), {3, 3, 3}, 0.5 * (a + delta));
    for (const Packing* packing : {&hexagonal, &fcc}) {
      const int d = packing->dimension();
      const Observables o = MeasureAtRest(*packing, alpha);
      const double fabric = (d == 2 ? 3.0 : 4.0) * o.packing_fraction;
      const double force = std::pow(delta, alpha - 1.0);
      const double pressure = d == 2 ? std::sqrt(3.0) * force / a
                                     : 2.0 * std::sqrt(2.0) * force / (a * a);
      // Overlaps are good to eps times the cell's length over delta.
      const double tolerance = 100.0 * kEps / delta;
      for (int r = 0; r < d; ++r) {
        for (int c = 0; c < d; ++c) {
          EXPECT_NEAR(
              o.fabric(r, c), r == c ? fabric : 0.0, tolerance * fabric);
          EXPECT_NEAR(
              o.stress(r, c), r == c ? pressure : 0.0, tolerance * pressure);
        }
      }
      EXPECT_NEAR(o.fabric_parts.isotropic, fabric, tolerance * fabric);
      EXPECT_NEAR(o.fabric_parts.deviatoric, 0.0, tolerance * fabric);
      EXPECT_NEAR(o.stress_parts.isotropic, pressure, tolerance * pressure);
      EXPECT_NEAR(o.stress_parts.deviatoric, 0.0, tolerance * pressure);
      EXPECT_NEAR(o.pressure, pressure, tolerance * pressure);
      EXPECT_NEAR(o.mean_force, force, tolerance * force);
      EXPECT_NEAR(o.smallest_force, force, tolerance * force);
      EXPECT_NEAR(o.mean_overlap, delta, tolerance * delta);
      EXPECT_EQ(o.rattlers, 0);
      EXPECT_EQ(o.coordination, d == 2 ? 6.0 : 12.0);
    }
  }
}

TEST(Observables, PureShearSplitsTheStressOfAHexagonalLattice) {
  // Compressed along y by 1%: the 60 degree bonds are shorter, those along x
  // longer. Everything from the three bonds by hand.
  const double a = 1.0;
  const double r = 0.52;
  Packing packing = BravaisLattice(HexagonalCell(a), {4, 4}, r);
  packing.Deform(PureShear(2, 0.01));
  const Observables o = MeasureAtRest(packing, 2.0);
  SmallMatrix stress = SmallMatrix::Zero(2, 2);
  SmallMatrix fabric = SmallMatrix::Zero(2, 2);
  const double grain = kPi * r * r;
  for (const double angle : {0.0, kPi / 3.0, 2.0 * kPi / 3.0}) {
    const SmallVector bond =
        PureShear(2, 0.01) * Vector2(a * std::cos(angle), a * std::sin(angle));
    const double l = bond.norm();
    stress += (2.0 * r - l) / l * bond * bond.transpose();
    fabric += 2.0 * grain / (l * l) * bond * bond.transpose();
  }
  const double cell = std::sqrt(3.0) / 2.0 * a * a;
  stress /= cell;
  fabric /= cell;
  // Overlaps of 0.03 from distances rounded to eps.
  const double tolerance = 100.0 * kEps / 0.03;
  EXPECT_LT((o.stress - stress).norm(), tolerance * stress.norm());
  EXPECT_LT((o.fabric - fabric).norm(), tolerance * fabric.norm());
  EXPECT_GT(o.stress(1, 1), o.stress(0, 0)) << "positive in compression";
  EXPECT_NEAR(o.stress_parts.deviatoric,
              0.5 * (stress(1, 1) - stress(0, 0)),
              tolerance * stress.norm());
  EXPECT_NEAR(o.stress_parts.isotropic, o.pressure, kEps * o.pressure * 4.0);
}

TEST(Observables, SimpleShearStressIsMinusSigma12) {
  for (const int d : {2, 3}) {
    Packing packing = d == 2 ? BravaisLattice(HexagonalCell(1.0), {4, 4}, 0.52)
                             : BravaisLattice(FccCell(1.0), {3, 3, 3}, 0.52);
    packing.Deform(SimpleShear(d, 0.01));
    const Observables o = MeasureAtRest(packing, 2.0);
    EXPECT_EQ(o.shear_stress, -o.stress(0, 1));
    EXPECT_GT(o.shear_stress, 0.0) << "resists the strain";
    EXPECT_LT((o.stress - o.stress.transpose()).norm(), kEps * o.stress.norm());
  }
}

// ---- the rigid part

// N grains and the contacts named, all of unit force along x: only who touches
// whom matters below.
Observables Peel(int dimension,
                 int grains,
                 const std::vector<std::pair<int, int>>& pairs) {
  Packing packing;
  packing.box = Box::Cube(dimension, 100.0);
  packing.positions.setZero(dimension, grains);
  packing.radii.setOnes(grains);
  std::vector<Contact> contacts;
  for (const auto& [i, j] : pairs) {
    Contact contact;
    contact.id = {std::min(i, j), std::max(i, j), {0, 0, 0}};
    contact.overlap = 1.0;
    contact.distance = 1.0;
    contact.normal = SmallVector::Unit(dimension, 0);
    contact.force = 1.0 + static_cast<double>(contacts.size());
    contacts.push_back(contact);
  }
  return Measure(packing, contacts, 0.0);
}

// Everyone in [first, first + count) touches everyone.
void AddClique(int first, int count, std::vector<std::pair<int, int>>* pairs) {
  for (int i = first; i < first + count; ++i) {
    for (int j = i + 1; j < first + count; ++j) pairs->push_back({i, j});
  }
}

TEST(Observables, AChainIsPeeledFromItsEndGrainByGrain) {
  for (const int d : {2, 3}) {
    // The core: d + 2 grains that all touch each other, d + 1 contacts each. On
    // it hangs a strip in which each grain touches the d before it: up to 2 d
    // contacts, d + 1 for the last but one. Only the very last has too few,
    // until it is gone.
    const int core = d + 2;
    const int strip = 12;
    std::vector<std::pair<int, int>> pairs;
    AddClique(0, core, &pairs);
    const int core_contacts = static_cast<int>(pairs.size());
    for (int k = 0; k < strip; ++k) {
      for (int before = 1; before <= d; ++before) {
        pairs.push_back({core + k - before, core + k});
      }
    }
    std::vector<int> degree(core + strip, 0);
    for (const auto& [i, j] : pairs) {
      ++degree[i];
      ++degree[j];
    }
    int few = 0;
    for (const int contacts : degree) few += contacts < d + 1;
    ASSERT_EQ(few, 1) << "at first only the end has too few";
    const Observables o = Peel(d, core + strip, pairs);
    EXPECT_EQ(o.contacts, static_cast<int>(pairs.size()));
    EXPECT_EQ(o.rattlers, strip);
    EXPECT_EQ(o.rigid_grains, core);
    EXPECT_EQ(o.rigid_contacts, core_contacts);
    EXPECT_EQ(o.coordination, 2.0 * core_contacts / core);
    EXPECT_EQ(o.isostatic_contacts, d * core - d + 1);
    EXPECT_EQ(o.smallest_force, 1.0);
    for (int i = 0; i < core + strip; ++i) {
      EXPECT_EQ(o.is_rattler[i], i >= core) << "grain " << i;
    }
  }
}

TEST(Observables, NothingIsRigidWithFewerThanThreeOrFourContactsAGrain) {
  for (const int d : {2, 3}) {
    std::vector<std::pair<int, int>> pairs;
    AddClique(0, d + 1, &pairs);  // d contacts each
    const Observables o = Peel(d, d + 3, pairs);
    EXPECT_EQ(o.rattlers, d + 3);
    EXPECT_EQ(o.rigid_grains, 0);
    EXPECT_EQ(o.rigid_contacts, 0);
    EXPECT_EQ(o.coordination, 0.0);
    EXPECT_EQ(o.isostatic_contacts, 0);
    EXPECT_EQ(o.smallest_force, 0.0);
    EXPECT_GT(o.mean_force, 0.0) << "the mean is over all contacts";
  }
}

TEST(Observables, SmallestForceIsOverTheRigidPart) {
  std::vector<std::pair<int, int>> pairs = {
      {0, 4}};  // the weakest, a rattler's
  AddClique(0, 4, &pairs);
  const Observables o = Peel(2, 5, pairs);
  EXPECT_EQ(o.rattlers, 1);
  EXPECT_EQ(o.smallest_force, 2.0);
  EXPECT_EQ(o.mean_force, 4.0);
}

TEST(Observables, PeelingDoesNotDependOnTheOrderOfGrains) {
  // A long strip between two rigid ends is rigid until one link is cut.
  for (const bool reversed : {false, true}) {
    const int n = 40;
    std::vector<std::pair<int, int>> pairs;
    AddClique(0, 4, &pairs);
    AddClique(n - 4, 4, &pairs);
    for (int i = 3; i < n - 4; ++i) {
      pairs.push_back({i, i + 1});
      if (i + 2 < n - 3) pairs.push_back({i, i + 2});
    }
    if (reversed) {
      for (auto& [i, j] : pairs) {
        i = n - 1 - i;
        j = n - 1 - j;
      }
    }
    const Observables o = Peel(2, n, pairs);
    // Grain n - 5 touches n - 4, n - 6 and n - 7: three. All stay.
    EXPECT_EQ(o.rattlers, 0);
    for (std::size_t cut = 0; cut < pairs.size(); ++cut) {
      if (std::min(pairs[cut].first, pairs[cut].second) < 4 ||
          std::max(pairs[cut].first, pairs[cut].second) > n - 5) {
        continue;
      }
      std::vector<std::pair<int, int>> rest = pairs;
      rest.erase(rest.begin() + static_cast<int>(cut));
      // The naive way: scan until nothing changes.
      std::vector<bool> gone(n, false);
      for (bool changed = true; changed;) {
        changed = false;
        std::vector<int> degree(n, 0);
        for (const auto& [i, j] : rest) {
          if (gone[i] || gone[j]) continue;
          ++degree[i];
          ++degree[j];
        }
        for (int i = 0; i < n; ++i) {
          if (!gone[i] && degree[i] < 3) gone[i] = changed = true;
        }
      }
      EXPECT_EQ(Peel(2, n, rest).is_rattler, gone) << "cut " << cut;
    }
  }
}

TEST(Observables, AGrainWedgedBetweenItsImagesCountsBothEnds) {
  // One grain in a square cell: contacts with its images along x and y, four
  // contacts for a grain, no net force.
  const Packing packing =
      MakePacking(Box::Cube(2, 1.0), Vector2(0.3, 0.4), {0.55});
  const Observables o = MeasureAtRest(packing, 2.0);
  EXPECT_EQ(o.contacts, 2);
  EXPECT_EQ(o.rattlers, 0);
  EXPECT_EQ(o.coordination, 4.0);
  EXPECT_EQ(o.isostatic_contacts, 1);
  EXPECT_EQ(o.max_residual, 0.0);
}

TEST(Observables, APackingWithoutContactsIsAllZero) {
  Eigen::MatrixXd x(3, 2);
  x << 1.0, 3.0, 1.0, 3.0, 1.0, 3.0;
  const Observables o =
      MeasureAtRest(MakePacking(Box::Cube(3, 8.0), x, {0.5, 0.5}), 2.0);
  EXPECT_EQ(o.contacts, 0);
  EXPECT_EQ(o.rattlers, 2);
  EXPECT_EQ(o.energy, 0.0);
  EXPECT_EQ(o.pressure, 0.0);
  EXPECT_EQ(o.mean_force, 0.0);
  EXPECT_EQ(o.mean_overlap, 0.0);
  EXPECT_EQ(o.smallest_force, 0.0);
  EXPECT_EQ(o.relative_residual, 0.0);
  EXPECT_EQ(o.stress.norm(), 0.0);
  EXPECT_EQ(o.fabric.norm(), 0.0);
}

// ---- tensors and volumes

TEST(Observables, SplitTensorHalvesSumAndDifferenceOfTheEigenvalues) {
  UniformRandom random(3);
  for (int k = 0; k < 50; ++k) {
    const double a = 2.0 * random() - 1.0;
    const double b = 2.0 * random() - 1.0;
    const double c = 2.0 * random() - 1.0;
    const double angle = 7.0 * random();
    SmallMatrix turn2 = Eigen::Rotation2Dd(angle).toRotationMatrix();
    const SmallMatrix plane =
        turn2 * Matrix2(a, 0.0, 0.0, b) * turn2.transpose();
    const TensorParts parts = SplitTensor(plane);
    EXPECT_NEAR(parts.isotropic, 0.5 * (a + b), 8.0 * kEps);
    EXPECT_NEAR(parts.deviatoric, 0.5 * std::abs(a - b), 8.0 * kEps);

    SmallMatrix turn3 =
        Eigen::AngleAxisd(angle, Eigen::Vector3d(a, b, c).normalized())
            .toRotationMatrix();
    SmallMatrix diagonal = SmallMatrix::Zero(3, 3);
    diagonal.diagonal() << a, b, c;
    const TensorParts space = SplitTensor(turn3 * diagonal * turn3.transpose());
    EXPECT_NEAR(space.isotropic, (a + b + c) / 3.0, 8.0 * kEps);
    EXPECT_NEAR(space.deviatoric,
                0.5 * (std::max({a, b, c}) - std::min({a, b, c})),
                8.0 * kEps);
  }
  // Only the symmetric part counts.
  const TensorParts skew = SplitTensor(Matrix2(1.0, 5.0, -5.0, 3.0));
  EXPECT_NEAR(skew.isotropic, 2.0, 4.0 * kEps);
  EXPECT_NEAR(skew.deviatoric, 1.0, 4.0 * kEps);
}

TEST(Observables, PackingFractionIsTheSumOfDiscsOrSpheresOverTheCell) {
  Packing discs = MakePacking(Box(Matrix2(2.0, 0.7, 0.0, 3.0)),
                              Eigen::MatrixXd::Zero(2, 2),
                              {0.5, 0.25});
  EXPECT_DOUBLE_EQ(discs.PackingFraction(), kPi * (0.25 + 0.0625) / 6.0);
  EXPECT_DOUBLE_EQ(MeasureAtRest(discs, 2.0).packing_fraction,
                   discs.PackingFraction());
  Packing spheres =
      MakePacking(Box::Cube(3, 2.0), Eigen::MatrixXd::Zero(3, 2), {0.5, 0.25});
  EXPECT_DOUBLE_EQ(spheres.PackingFraction(),
                   4.0 / 3.0 * kPi * (0.125 + 0.015625) / 8.0);
  // Touching hexagonal discs and fcc spheres.
  EXPECT_NEAR(BravaisLattice(HexagonalCell(1.0), {3, 3}, 0.5).PackingFraction(),
              kPi / std::sqrt(12.0),
              4.0 * kEps);
  EXPECT_NEAR(BravaisLattice(FccCell(1.0), {2, 2, 2}, 0.5).PackingFraction(),
              kPi / std::sqrt(18.0),
              4.0 * kEps);
}

}  // namespace
}  // namespace granopt
