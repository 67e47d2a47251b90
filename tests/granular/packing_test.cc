#include "granular/packing.h"

#include <quadmath.h>

#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "Eigen/LU"
#include "granular/box.h"
#include "granular/double_double.h"
#include "granular/packing_generator.h"
#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

Quad Exact(const DoubleDouble& x) { return Quad(x.hi) + Quad(x.lo); }

Packing Generate(const GeneratorOptions& options) {
  Packing packing;
  std::string error;
  EXPECT_TRUE(GeneratePacking(options, &packing, &error)) << error;
  EXPECT_TRUE(packing.IsValid(&error)) << error;
  return packing;
}

// ---- generator

TEST(PackingGenerator, DrawsTheExactNumberOfEachSpecies) {
  const auto count = [](const Packing& packing) {
    std::map<std::string, int> counts;
    for (const std::string& name : packing.species) ++counts[name];
    return counts;
  };
  GeneratorOptions options;
  for (const int d : {2, 3}) {
    options.dimension = d;
    for (const int n : {1, 2, 100, 1001}) {
      options.particles = n;
      const Packing packing = Generate(options);
      ASSERT_EQ(packing.size(), n);
      EXPECT_EQ(packing.dimension(), d);
      auto counts = count(packing);
      EXPECT_EQ(counts["A"], (n + 1) / 2);  // n / 2, halves rounded up
      EXPECT_EQ(counts["B"], n / 2);
    }
  }
  // Fractions need not add up to one.
  options.dimension = 2;
  options.particles = 60;
  options.species = {{"X", 1.0, 1.0}, {"Y", 2.0, 3.0}, {"Z", 3.0, 0.5}};
  const Packing packing = Generate(options);
  auto counts = count(packing);
  EXPECT_EQ(counts["X"], 10);
  EXPECT_EQ(counts["Y"], 20);
  EXPECT_EQ(counts["Z"], 30);
  double unit = 0.0;
  for (int i = 0; i < packing.size(); ++i) {
    if (packing.species[i] == "X") unit = packing.radii[i];
  }
  for (int i = 0; i < packing.size(); ++i) {
    const double relative = packing.species[i] == "X"   ? 1.0
                            : packing.species[i] == "Y" ? 3.0
                                                        : 0.5;
    EXPECT_DOUBLE_EQ(packing.radii[i], relative * unit);
  }
}

TEST(PackingGenerator, FillsTheUnitCellToThePackingFraction) {
  GeneratorOptions options;
  for (const int d : {2, 3}) {
    for (const double phi : {0.01, 0.64, 0.8438, 2.0}) {
      options.dimension = d;
      options.packing_fraction = phi;
      const Packing packing = Generate(options);
      EXPECT_EQ(packing.box.edges(), (SmallMatrix::Identity(d, d)));
      EXPECT_GE(packing.positions.minCoeff(), 0.0);
      EXPECT_LT(packing.positions.maxCoeff(), 1.0);
      // A sum of 1024 terms.
      EXPECT_NEAR(packing.PackingFraction() / phi, 1.0, 1e-13);
      EXPECT_EQ(packing.attributes.at("seed"), "1");
    }
  }
}

TEST(PackingGenerator, CentresAreUniformAndIndependentOfTheSpecies) {
  GeneratorOptions options;
  options.particles = 20000;
  const Packing packing = Generate(options);
  // Quarters of the cell by species: binomial, five standard deviations.
  for (int quarter = 0; quarter < 4; ++quarter) {
    int grains = 0, large = 0;
    for (int i = 0; i < packing.size(); ++i) {
      const int right = packing.positions(0, i) >= 0.5;
      const int upper = packing.positions(1, i) >= 0.5;
      if (2 * right + upper != quarter) continue;
      ++grains;
      large += packing.species[i] == "B";
    }
    EXPECT_NEAR(grains, 5000.0, 5.0 * std::sqrt(20000 * 0.25 * 0.75));
    EXPECT_NEAR(large, 0.5 * grains, 5.0 * std::sqrt(0.25 * grains));
  }
}

TEST(PackingGenerator, NeighboursInMemoryAreNeighboursInSpace) {
  for (const int d : {2, 3}) {
    GeneratorOptions options;
    options.dimension = d;
    options.particles = 4096;
    const Packing packing = Generate(options);
    double path = 0.0;
    for (int i = 1; i < packing.size(); ++i) {
      path += (packing.positions.col(i) - packing.positions.col(i - 1)).norm();
    }
    // In units of the typical distance; without an order it would be 33 (8 in
    // 3D).
    EXPECT_LT(path / 4095.0 * std::pow(4096.0, 1.0 / d), 2.0);
  }
}

TEST(PackingGenerator, TheSameSeedGivesTheSamePackingOnEveryMachine) {
  GeneratorOptions options;
  options.particles = 100;
  // Recorded. Coordinates are 53 bits of the Mersenne twister, whose output the
  // standard fixes; radii pass through pow.
  struct Grain {
    int dimension;
    std::uint64_t seed;
    int index;
    double x[3];
    double radius;
    const char* species;
  };
  const Grain recorded[] = {
      {2,
       1,
       0,
       {0.084576673511092659, 0.0006079551298032726},
       0.059506154383788375,
       "B"},
      {2,
       1,
       1,
       {0.1193531928673558, 0.069118951954526109},
       0.04250439598842027,
       "A"},
      {2,
       1,
       2,
       {0.011375847732978728, 0.14302225048009565},
       0.04250439598842027,
       "A"},
      {2,
       2,
       0,
       {0.057294878141755712, 0.070623789797750858},
       0.042504395988420277,
       "A"},
      {3,
       1,
       0,
       {0.084576673511092659, 0.0006079551298032726, 0.13416534604812969},
       0.14324835600253011,
       "B"},
      {3,
       2,
       0,
       {0.22454065627462305, 0.099650335255241251, 0.0220877386703211},
       0.14324835600253011,
       "B"},
  };
  for (const Grain& grain : recorded) {
    options.dimension = grain.dimension;
    options.seed = grain.seed;
    const Packing packing = Generate(options);
    for (int k = 0; k < grain.dimension; ++k) {
      EXPECT_EQ(packing.positions(k, grain.index), grain.x[k]);
    }
    EXPECT_NEAR(packing.radii[grain.index] / grain.radius, 1.0, 8.0 * kEps);
    EXPECT_EQ(packing.species[grain.index], grain.species);
  }
  // The generator's 10000th output for seed 5489 is in the standard.
  UniformRandom random(5489);
  for (int k = 0; k < 9999; ++k) random();
  EXPECT_EQ(random(),
            static_cast<double>(9981545732273789042ULL >> 11) * 0x1.0p-53);
}

TEST(PackingGenerator, AnotherSeedGivesAnotherPacking) {
  GeneratorOptions options;
  for (const int d : {2, 3}) {
    options.dimension = d;
    options.seed = 7;
    const Packing a = Generate(options);
    const Packing again = Generate(options);
    EXPECT_EQ(a.positions, again.positions);
    EXPECT_EQ(a.radii, again.radii);
    EXPECT_EQ(a.species, again.species);
    options.seed = 8;
    const Packing b = Generate(options);
    EXPECT_NE(a.positions, b.positions);
    EXPECT_NE(a.species, b.species);
    for (int i = 0; i < a.size(); ++i) {
      EXPECT_GT((a.positions - b.positions.col(i).replicate(1, a.size()))
                    .colwise()
                    .norm()
                    .minCoeff(),
                0.0)
          << "no grain is shared";
    }
  }
}

TEST(PackingGenerator, SpreadsRadiiUniformlyAboutThoseOfTheSpecies) {
  GeneratorOptions options;
  options.particles = 10000;
  const Packing two = Generate(options);
  constexpr double kWidth = 1e-3;
  options.polydispersity = kWidth;
  const Packing many = Generate(options);
  EXPECT_EQ(many.positions, two.positions) << "the same places";
  EXPECT_EQ(many.species, two.species);
  EXPECT_NEAR(many.PackingFraction(), options.packing_fraction, 1e-14);
  // Factors to the common scale, which the packing fraction sets.
  Eigen::ArrayXd u = many.radii.array() / two.radii.array();
  u = (u / u.mean() - 1.0) / kWidth;
  EXPECT_NEAR(u.maxCoeff(), 1.0, 0.03);
  EXPECT_NEAR(u.minCoeff(), -1.0, 0.03);
  EXPECT_NEAR(u.square().mean(), 1.0 / 3.0, 0.015) << "five standard errors";
}

TEST(PackingGenerator, RefusesOptionsOutOfRangeInOneLine) {
  const auto refused = [](const std::function<void(GeneratorOptions*)>& spoil,
                          const std::string& why) {
    GeneratorOptions options;
    spoil(&options);
    Packing packing;
    std::string error;
    EXPECT_FALSE(GeneratePacking(options, &packing, &error));
    EXPECT_NE(error.find(why), std::string::npos) << error;
    EXPECT_EQ(error.find('\n'), std::string::npos) << "one line";
  };
  const double nan = std::nan("");
  refused([](auto* o) { o->dimension = 1; }, "dimension = 1");
  refused([](auto* o) { o->dimension = 4; }, "dimension = 4");
  refused([](auto* o) { o->particles = 0; }, "particles = 0");
  refused([](auto* o) { o->particles = -5; }, "particles = -5");
  refused([](auto* o) { o->packing_fraction = 0.0; }, "phi = 0");
  refused([](auto* o) { o->packing_fraction = 5.0; }, "phi = 5");
  refused([&](auto* o) { o->packing_fraction = nan; }, "phi = nan");
  refused([](auto* o) { o->polydispersity = 1.0; }, "polydispersity = 1");
  refused([](auto* o) { o->polydispersity = -0.1; }, "polydispersity = -0.1");
  refused([&](auto* o) { o->polydispersity = nan; }, "polydispersity = nan");
  refused([](auto* o) { o->species.clear(); }, "species");
  refused([](auto* o) { o->species[1].relative_radius = 0.0; }, "species B");
  refused([&](auto* o) { o->species[1].relative_radius = nan; }, "species B");
  refused([](auto* o) { o->species[0].number_fraction = -1.0; }, "species A");
  refused(
      [](auto* o) {
        for (SpeciesOptions& s : o->species) s.number_fraction = 0.0;
      },
      "species");
}

// ---- packings

TEST(Packing, DeformMovesPositionsAndCellInDoubleDouble) {
  for (const int d : {2, 3}) {
    for (const bool low : {false, true}) {
      Packing packing = RandomPacking(d, 30, 0.9, 3);
      if (low) packing.Perturb(1e-9, 4);
      const Packing before = packing;
      SmallMatrix deformation = SimpleShear(d, 0.37);
      deformation(0, 0) = 1.1;
      deformation(1, 0) = -1.0 / 3.0;
      deformation(d - 1, d - 1) = 0.7;
      packing.Deform(deformation);
      EXPECT_EQ(packing.box.edges(),
                SmallMatrix(deformation * before.box.edges()));
      EXPECT_EQ(packing.radii, before.radii);
      for (int i = 0; i < packing.size(); ++i) {
        for (int r = 0; r < d; ++r) {
          Quad expected = 0;
          for (int c = 0; c < d; ++c) {
            expected += Quad(deformation(r, c)) * Exact(before.Position(i, c));
          }
          EXPECT_LE(std::abs(static_cast<double>(Exact(packing.Position(i, r)) -
                                                 expected)),
                    1e-31);
        }
      }
    }
  }
}

TEST(Packing, ShearsAreThoseOfThePaper) {
  for (const int d : {2, 3}) {
    SmallMatrix simple = SmallMatrix::Identity(d, d);
    simple(0, 1) = 0.25;
    EXPECT_EQ(SimpleShear(d, 0.25), simple);
    SmallMatrix pure = SmallMatrix::Identity(d, d);
    pure(0, 0) = 1.25;
    pure(1, 1) = 0.8;
    EXPECT_EQ(PureShear(d, 0.25), pure);
    EXPECT_NEAR(PureShear(d, 0.1).determinant(), 1.0, 2.0 * kEps);
  }
}

// Copies differ by vectors of the lattice, exactly, in a cell that holds as
// many.
TEST(Packing, CopiesLieSideBySide) {
  for (const int d : {2, 3}) {
    Packing packing = RandomPacking(d, 12, 0.5, 7);
    packing.Deform(SimpleShear(d, 0.3));
    packing.Perturb(1e-9, 4);
    packing.species.assign(12, "B");
    const int n = 3;
    const Packing copies = packing.Copies(n);
    const int count = d == 2 ? 9 : 27;
    std::string error;
    ASSERT_TRUE(copies.IsValid(&error)) << error;
    ASSERT_EQ(copies.size(), 12 * count);
    EXPECT_EQ(copies.species.size(), static_cast<std::size_t>(12 * count));
    EXPECT_NEAR(copies.PackingFraction(), packing.PackingFraction(), 1e-14);
    std::set<std::vector<int>> places;
    for (int c = 0; c < count; ++c) {
      std::vector<int> place;
      for (int i = 0; i < 12; ++i) {
        EXPECT_EQ(copies.radii[12 * c + i], packing.radii[i]);
        Eigen::VectorXd shift(d);
        for (int k = 0; k < d; ++k) {
          const DoubleDouble moved =
              copies.Position(12 * c + i, k) - packing.Position(i, k);
          shift[k] = moved.Value();
        }
        const Eigen::VectorXd cells = packing.box.inverse() * shift;
        place.clear();
        for (int k = 0; k < d; ++k) {
          place.push_back(static_cast<int>(std::lround(cells[k])));
          EXPECT_NEAR(cells[k], place.back(), 1e-15);
          EXPECT_TRUE(place.back() >= 0 && place.back() < n);
        }
      }
      places.insert(place);
    }
    EXPECT_EQ(places.size(), static_cast<std::size_t>(count));
  }
}

TEST(Packing, PerturbAddsUniformNumbersWithoutRounding) {
  for (const int d : {2, 3}) {
    const Packing before = RandomPacking(d, 500, 0.9, 5);
    const double amplitude = 1e-7;
    Packing a = before, b = before, c = before;
    a.Perturb(amplitude, 11);
    b.Perturb(amplitude, 11);
    c.Perturb(amplitude, 12);
    EXPECT_EQ(a.positions, b.positions);
    EXPECT_EQ(a.positions_low, b.positions_low);
    EXPECT_NE(a.positions_low, c.positions_low);
    UniformRandom random(11);
    double sum = 0.0, sum2 = 0.0;
    for (int i = 0; i < before.size(); ++i) {
      for (int k = 0; k < d; ++k) {
        const double moved = static_cast<double>(Exact(a.Position(i, k)) -
                                                 Exact(before.Position(i, k)));
        // A plain coordinate would have 1e-9 of it as roundoff.
        EXPECT_NEAR(moved / (amplitude * (2.0 * random() - 1.0)), 1.0, 1e-15);
        EXPECT_LE(std::abs(moved), amplitude);
        sum += moved / amplitude;
        sum2 += moved * moved / (amplitude * amplitude);
      }
    }
    // Mean 0 and variance 1/3 within five standard deviations.
    const double n = d * before.size();
    EXPECT_NEAR(sum / n, 0.0, 5.0 * std::sqrt(1.0 / (3.0 * n)));
    EXPECT_NEAR(sum2 / n, 1.0 / 3.0, 5.0 * std::sqrt(4.0 / (45.0 * n)));
  }
}

TEST(Packing, WrapMovesGrainsByLatticeVectorsExactly) {
  for (const int d : {2, 3}) {
    std::vector<Box> boxes = {Box::Cube(d, 1.0),
                              Box(SmallMatrix(SimpleShear(d, 0.49))),
                              Box(SmallMatrix(SimpleShear(d, -12.0)))};
    for (int seed = 1; seed <= 4; ++seed) boxes.push_back(RandomBox(d, seed));
    for (const Box& box : boxes) {
      Packing packing = RandomPacking(d, 50, 0.5, 6);
      packing.box = box;
      packing.positions = box.edges() * packing.positions;
      packing.Perturb(7.0, 13);
      const Packing before = packing;
      packing.Wrap();
      int moved = 0;
      for (int i = 0; i < packing.size(); ++i) {
        // Fractional coordinates in the cell, up to rounding.
        const SmallVector f = box.inverse() * packing.positions.col(i);
        EXPECT_GE(f.minCoeff(), -64.0 * kEps);
        EXPECT_LT(f.maxCoeff(), 1.0 + 64.0 * kEps);
        // The shift is H n with integers n.
        Eigen::VectorXd shift(d);
        Quad exact[3];
        for (int k = 0; k < d; ++k) {
          exact[k] =
              Exact(before.Position(i, k)) - Exact(packing.Position(i, k));
          shift[k] = static_cast<double>(exact[k]);
        }
        const Eigen::VectorXd n = (box.inverse() * shift).array().round();
        moved += n.norm() > 0.0;
        for (int k = 0; k < d; ++k) {
          Quad lattice = 0;
          double path = 1.0;
          for (int c = 0; c < d; ++c) {
            lattice += Quad(box.edges()(k, c)) * Quad(n[c]);
            path += std::abs(box.edges()(k, c) * n[c]);
          }
          // 2^-104 = 5e-32 of the lattice vectors' lengths.
          EXPECT_LE(std::abs(static_cast<double>(exact[k] - lattice)),
                    1e-31 * path);
          if (n.norm() == 0.0) {
            EXPECT_EQ(before.positions(k, i), packing.positions(k, i));
          }
        }
      }
      EXPECT_GT(moved, 25);
      const Packing once = packing;
      packing.Wrap();
      EXPECT_EQ(packing.positions, once.positions);
      EXPECT_EQ(packing.positions_low, once.positions_low);
    }
  }
}

TEST(Packing, PackingFractionAndMeanRadius) {
  EXPECT_DOUBLE_EQ(GrainVolume(2, 0.5), kPi / 4.0);
  EXPECT_DOUBLE_EQ(GrainVolume(3, 0.5), kPi / 6.0);
  for (const int d : {2, 3}) {
    Packing packing = RandomPacking(d, 100, 0.8, 7, SimpleShear(d, 0.4));
    // Half of radius r, half of radius 1.4 r.
    const double r = packing.radii.minCoeff();
    EXPECT_NEAR(packing.MeanRadius() / (1.2 * r), 1.0, 1e-14);
    EXPECT_NEAR(packing.PackingFraction() /
                    (50.0 * (GrainVolume(d, r) + GrainVolume(d, 1.4 * r)) /
                     packing.box.Volume()),
                1.0,
                1e-13);
    packing.ScaleRadii(0.5);
    EXPECT_NEAR(
        packing.PackingFraction() / (0.8 * std::pow(0.5, d)), 1.0, 1e-13);
    packing.SetPackingFraction(0.6);
    EXPECT_NEAR(packing.PackingFraction() / 0.6, 1.0, 1e-14);
  }
}

TEST(Packing, IsValidNamesTheGrainAndTheValueAtFault) {
  const Packing good = RandomPacking(3, 6, 0.5, 8);
  std::string error;
  EXPECT_TRUE(good.IsValid(&error)) << error;
  const auto invalid = [&good](const std::function<void(Packing*)>& spoil,
                               const std::vector<std::string>& why) {
    Packing packing = good;
    packing.positions_low.setZero(3, 6);
    packing.stiffness.setOnes(6);
    std::string line;
    EXPECT_TRUE(packing.IsValid(&line)) << line;
    spoil(&packing);
    EXPECT_FALSE(packing.IsValid(&line));
    for (const std::string& word : why) {
      EXPECT_NE(line.find(word), std::string::npos) << line;
    }
    EXPECT_EQ(line.find('\n'), std::string::npos) << "one line";
  };
  const double nan = std::nan("");
  const double infinity = std::numeric_limits<double>::infinity();
  invalid([](Packing* p) { p->radii.resize(0); }, {"no grains"});
  invalid([](Packing* p) { *p = Packing(); }, {"no grains"});
  for (const double bad : {nan, infinity, -infinity}) {
    invalid([bad](Packing* p) { p->positions(1, 4) = bad; },
            {"grain 4", "position"});
  }
  invalid([nan](Packing* p) { p->positions_low(2, 5) = nan; },
          {"grain 5", "position"});
  invalid([](Packing* p) { p->positions(0, 2) = -3e7; },
          {"grain 2", "position"});
  invalid([](Packing* p) { p->radii[3] = 0.0; }, {"grain 3", "radius = 0"});
  invalid([](Packing* p) { p->radii[3] = -0.25; },
          {"grain 3", "radius = -0.25"});
  invalid([nan](Packing* p) { p->radii[1] = nan; }, {"grain 1", "radius"});
  invalid([infinity](Packing* p) { p->radii[1] = infinity; },
          {"grain 1", "radius"});
  invalid([](Packing* p) { p->stiffness[0] = 0.0; },
          {"grain 0", "stiffness = 0"});
  invalid([nan](Packing* p) { p->stiffness[5] = nan; },
          {"grain 5", "stiffness"});
  invalid([](Packing* p) { p->box = Box(SmallMatrix::Zero(3, 3)); }, {"cell"});
  invalid([](Packing* p) { p->box = Box::Cube(2, 1.0); }, {"lengths"});
  invalid([](Packing* p) { p->positions.setZero(3, 5); }, {"lengths"});
  invalid([](Packing* p) { p->positions_low.setZero(2, 6); }, {"lengths"});
  invalid([](Packing* p) { p->stiffness.setOnes(7); }, {"lengths"});
  invalid([](Packing* p) { p->species.resize(2); }, {"lengths"});
}

// ---- cells

TEST(Box, VolumeHeightsAndImages) {
  const Box sheared(Matrix2(2.0, 1.5, 0.0, 3.0));
  EXPECT_EQ(sheared.dimension(), 2);
  EXPECT_DOUBLE_EQ(sheared.Volume(), 6.0);
  EXPECT_DOUBLE_EQ(sheared.Length(), std::sqrt(6.0));
  EXPECT_DOUBLE_EQ(sheared.Height(0), 6.0 / std::hypot(1.5, 3.0));
  EXPECT_DOUBLE_EQ(sheared.Height(1), 3.0);
  EXPECT_DOUBLE_EQ(Box::Cube(3, 2.0).Volume(), 8.0);
  EXPECT_DOUBLE_EQ(Box::Cube(3, 2.0).Length(), 2.0);
  // A left-handed cell has a positive volume.
  EXPECT_DOUBLE_EQ(Box(Matrix2(0.0, 1.0, 2.0, 0.0)).Volume(), 2.0);
  for (const int d : {2, 3}) {
    for (int seed = 1; seed <= 5; ++seed) {
      const Box box = RandomBox(d, seed);
      UniformRandom random(seed);
      for (int trial = 0; trial < 20; ++trial) {
        SmallVector x = SmallVector::Zero(d);
        Image n = {0, 0, 0};
        for (int k = 0; k < d; ++k) {
          n[k] = static_cast<int>(std::floor(21.0 * random())) - 10;
          // Away from the faces, where rounding decides.
          x += (n[k] + 0.01 + 0.98 * random()) * box.edges().col(k);
        }
        EXPECT_EQ(box.CellOf(x.data()), n);
      }
      const SmallMatrix shear = SimpleShear(d, 0.3);
      EXPECT_EQ(box.Deformed(shear).edges(), SmallMatrix(shear * box.edges()));
    }
  }
}

TEST(Box, IsValidUnlessSingularOrNotFinite) {
  EXPECT_TRUE(Box().IsValid());
  for (const int d : {2, 3}) {
    EXPECT_TRUE(Box::Cube(d, 1e-30).IsValid()) << "no unit of length";
    EXPECT_TRUE(Box::Cube(d, 1e30).IsValid());
    EXPECT_TRUE(Box(SimpleShear(d, 50.0)).IsValid());
    EXPECT_FALSE(Box::Cube(d, 0.0).IsValid());
    EXPECT_FALSE(Box::Cube(d, std::nan("")).IsValid());
    SmallMatrix flat = SmallMatrix::Identity(d, d);
    flat.col(1) = flat.col(0);
    EXPECT_FALSE(Box(flat).IsValid());
    flat(1, 1) = 1e-13;
    EXPECT_FALSE(Box(flat).IsValid());
    SmallMatrix infinite = SmallMatrix::Identity(d, d);
    infinite(0, 1) = std::numeric_limits<double>::infinity();
    EXPECT_FALSE(Box(infinite).IsValid());
  }
  EXPECT_FALSE(Box(SmallMatrix::Identity(1, 1)).IsValid());
}

TEST(Box, ReducedIsTheSameLatticeWithShortEdges) {
  for (const int d : {2, 3}) {
    std::vector<Box> boxes = {Box::Cube(d, 1.0)};
    for (const double gamma : {0.49, 1.0, 3.7, -12.0, 1000.25}) {
      SmallMatrix shear = SimpleShear(d, gamma);
      boxes.emplace_back(shear);
      if (d == 3) {
        shear(1, 2) = 2.6;
        shear(0, 2) = -gamma;
        boxes.emplace_back(shear);
      }
    }
    for (int seed = 1; seed <= 10; ++seed) {
      boxes.push_back(
          Box(SmallMatrix(SimpleShear(d, seed) * RandomBox(d, seed).edges())));
    }
    for (const Box& box : boxes) {
      SCOPED_TRACE(testing::Message() << "cell " << box.edges());
      Eigen::Matrix3i transform;
      const Box reduced = box.Reduced(&transform);
      // Unimodular: the same points.
      EXPECT_EQ(std::abs(transform.cast<double>().determinant()), 1.0);
      const double longest = box.edges().cwiseAbs().maxCoeff();
      const SmallMatrix product =
          box.edges() * transform.topLeftCorner(d, d).cast<double>();
      EXPECT_LT((reduced.edges() - product).cwiseAbs().maxCoeff(),
                1e-14 * longest);
      EXPECT_NEAR(reduced.Volume() / box.Volume(), 1.0, 1e-12 * longest);
      // No edge gets shorter by adding another.
      for (int a = 0; a < d; ++a) {
        for (int b = 0; b < d; ++b) {
          if (a == b) continue;
          EXPECT_LE(
              std::abs(reduced.edges().col(a).dot(reduced.edges().col(b))),
              (0.5 + 1e-12) * reduced.edges().col(b).squaredNorm());
        }
      }
      if (d == 2) {
        // Then heights are at least sqrt(3) / 2 of the edges across.
        const double shortest = std::min(reduced.edges().col(0).norm(),
                                         reduced.edges().col(1).norm());
        EXPECT_GE(std::min(reduced.Height(0), reduced.Height(1)),
                  (std::sqrt(0.75) - 1e-12) * shortest);
      }
    }
  }
}

// ---- double-double
// --------------------------------------------------------------

constexpr double kUnit2 = 0x1.0p-106;  // u^2, u = 2^-53

// Any sign, 60 binades, all bits in use.
double RandomDouble(UniformRandom* random, int exponents) {
  const double mantissa = 1.0 + (*random)();
  const int exponent =
      static_cast<int>(std::floor((*random)() * (2 * exponents + 1))) -
      exponents;
  return std::ldexp((*random)() < 0.5 ? -mantissa : mantissa, exponent);
}

DoubleDouble RandomDoubleDouble(UniformRandom* random, int exponents) {
  const double high = RandomDouble(random, exponents);
  return FastTwoSum(high, high * 0x1.0p-53 * (2.0 * (*random)() - 1.0));
}

// |lo| <= ulp(hi) / 2: hi is the sum, rounded.
void ExpectNormalized(const DoubleDouble& x) {
  EXPECT_EQ(x.hi, x.hi + x.lo);
  EXPECT_EQ(x.Value(), x.hi);
}

double RelativeError(const DoubleDouble& x, Quad expected) {
  if (expected == 0) return x.hi == 0.0 && x.lo == 0.0 ? 0.0 : 1.0;
  return static_cast<double>(fabsq(Exact(x) / expected - 1));
}

TEST(DoubleDouble, TwoSumAndTwoProductAreExact) {
  UniformRandom random(1);
  for (int trial = 0; trial < 20000; ++trial) {
    // Within 113 bits, which is what the oracle has.
    const double a = RandomDouble(&random, 25);
    const double b = RandomDouble(&random, 25);
    const DoubleDouble sum = TwoSum(a, b);
    EXPECT_EQ(static_cast<double>(Exact(sum) - (Quad(a) + Quad(b))), 0.0);
    ExpectNormalized(sum);
    const DoubleDouble ordered =
        std::abs(a) >= std::abs(b) ? FastTwoSum(a, b) : FastTwoSum(b, a);
    EXPECT_EQ(ordered.hi, sum.hi);
    EXPECT_EQ(ordered.lo, sum.lo);
    const DoubleDouble product = TwoProduct(a, b);
    EXPECT_EQ(static_cast<double>(Exact(product) - Quad(a) * Quad(b)), 0.0);
    ExpectNormalized(product);
  }
  EXPECT_EQ(FastTwoSum(0.0, 3.0).hi, 3.0);
  const DoubleDouble tiny = TwoSum(1.0, 1e-200);
  EXPECT_EQ(tiny.hi, 1.0);
  EXPECT_EQ(tiny.lo, 1e-200);
}

// Bounds: Joldes, Muller, Popescu, ACM Trans. Math. Softw. 44 (2017) 15: 3 u^2
// for the sum also where it cancels, 5 u^2 for the product without lo lo.
TEST(DoubleDouble, SumsProductsAndRootsKeepThirtyOneDigits) {
  UniformRandom random(2);
  for (int trial = 0; trial < 20000; ++trial) {
    const DoubleDouble a = RandomDoubleDouble(&random, 10);
    DoubleDouble b = RandomDoubleDouble(&random, 10);
    if (trial % 3 == 0) {
      // Close to -a: all but the last few of 5 to 100 bits cancel.
      const int bits = 5 + trial % 95;
      b = -a + DoubleDouble(a.hi * std::ldexp(random(), -bits));
    }
    const Quad sum = (Quad(a.hi) + Quad(b.hi)) + (Quad(a.lo) + Quad(b.lo));
    EXPECT_LE(RelativeError(a + b, sum), 3.01 * kUnit2) << "trial " << trial;
    ExpectNormalized(a + b);
    const Quad difference =
        (Quad(a.hi) - Quad(b.hi)) + (Quad(a.lo) - Quad(b.lo));
    EXPECT_LE(RelativeError(a - b, difference), 3.01 * kUnit2);
    EXPECT_LE(RelativeError(a * b, Exact(a) * Exact(b)), 5.01 * kUnit2);
    ExpectNormalized(a * b);
    const DoubleDouble square = a.hi > 0.0 ? a : -a;
    // One Newton step from a root good to u: u^2 / 2, and roundings of the
    // correction.
    EXPECT_LE(RelativeError(Sqrt(square), sqrtq(Exact(square))), 4.0 * kUnit2);
    ExpectNormalized(Sqrt(square));
  }
}

TEST(DoubleDouble, Zeros) {
  const DoubleDouble third(1.0 / 3.0, 1e-17);
  const DoubleDouble zero = third - third;
  EXPECT_EQ(zero.hi, 0.0);
  EXPECT_EQ(zero.lo, 0.0);
  EXPECT_EQ((third + DoubleDouble(0.0)).hi, third.hi);
  EXPECT_EQ((third + DoubleDouble(0.0)).lo, third.lo);
  EXPECT_EQ((third * DoubleDouble(0.0)).Value(), 0.0);
  EXPECT_EQ(Sqrt(DoubleDouble(0.0)).Value(), 0.0);
  EXPECT_EQ(Sqrt(DoubleDouble(4.0)).hi, 2.0);
  EXPECT_EQ(Sqrt(DoubleDouble(4.0)).lo, 0.0);
  EXPECT_EQ(DoubleDouble(2.5).lo, 0.0);
  EXPECT_EQ((-third).hi, -third.hi);
  EXPECT_EQ((-third).lo, -third.lo);
}

}  // namespace
}  // namespace granopt
