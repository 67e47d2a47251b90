#include "granular/neighbor_list.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <vector>

#include "gtest/gtest.h"
#include "tests/granular/test_packings.h"

namespace granopt {
namespace {

std::vector<GapId> Ids(const NeighborList& list) {
  std::vector<GapId> ids;
  const int n = static_cast<int>(list.row_start.size()) - 1;
  for (int i = 0; i < n; ++i) {
    for (int p = list.row_start[i]; p < list.row_start[i + 1]; ++p) {
      ids.push_back({i, list.j[p], list.image[p]});
    }
  }
  return ids;
}

// Rows compressed by i, in strictly increasing order of (j, image), each pair
// under one of its two names only.
void ExpectCanonical(const NeighborList& list, int n, int dimension) {
  ASSERT_EQ(static_cast<int>(list.row_start.size()), n + 1);
  ASSERT_EQ(list.j.size(), list.image.size());
  EXPECT_EQ(list.row_start.front(), 0);
  EXPECT_EQ(list.row_start.back(), list.num_pairs());
  const std::vector<GapId> ids = Ids(list);
  ASSERT_EQ(static_cast<int>(ids.size()), list.num_pairs());
  for (std::size_t p = 0; p < ids.size(); ++p) {
    if (p > 0) {
      EXPECT_TRUE(ids[p - 1] < ids[p]) << "not increasing at " << p;
    }
    EXPECT_LE(ids[p].i, ids[p].j);
    EXPECT_LT(ids[p].j, n);
    if (ids[p].i == ids[p].j) {
      EXPECT_GT(ids[p].image, (Image{0, 0, 0}))
          << "the first non-zero entry must be positive";
    }
    for (int k = dimension; k < 3; ++k) EXPECT_EQ(ids[p].image[k], 0);
  }
}

// The list holds what the oracle finds. A pair whose distance agrees with the
// range to 1e-12 may be in the list or not. Returns the number of pairs.
int ExpectMatchesOracle(const Box& box,
                        const Eigen::MatrixXd& positions,
                        const Eigen::VectorXd& radii,
                        double skin) {
  const int n = static_cast<int>(radii.size());
  NeighborList list;
  std::string error;
  EXPECT_TRUE(BuildNeighborList(box, positions, radii, skin, &list, &error))
      << error;
  ExpectCanonical(list, n, box.dimension());
  const auto range = [&](int i, int j) {
    return static_cast<long double>(radii[i] + radii[j] + skin);
  };
  const std::vector<ImagePair> all = AllImagePairs(
      box, positions, [&](int i, int j) { return range(i, j) * (1 + 1e-12L); });
  std::set<GapId> required, allowed;
  for (const ImagePair& pair : all) {
    allowed.insert(pair.id);
    if (pair.distance < range(pair.id.i, pair.id.j) * (1 - 1e-12L)) {
      required.insert(pair.id);
    }
  }
  const std::vector<GapId> ids = Ids(list);
  const std::set<GapId> found(ids.begin(), ids.end());
  EXPECT_EQ(found.size(), ids.size()) << "a pair is listed twice";
  EXPECT_TRUE(std::includes(
      found.begin(), found.end(), required.begin(), required.end()))
      << "a pair is missing";
  EXPECT_TRUE(
      std::includes(allowed.begin(), allowed.end(), found.begin(), found.end()))
      << "a pair is too far apart, or not where its image says";
  return list.num_pairs();
}

// Cells of volume of the order of one: square, rectangular, strongly sheared
// (in 3D in two planes), random.
std::vector<Box> Cells(int dimension) {
  std::vector<Box> cells = {Box::Cube(dimension, 1.0)};
  SmallMatrix brick = SmallMatrix::Identity(dimension, dimension);
  brick(0, 0) = 3.0;
  brick(1, 1) = 0.5;
  cells.emplace_back(brick);
  for (const double gamma : {0.49, 3.7, -12.0}) {
    SmallMatrix shear = SimpleShear(dimension, gamma);
    cells.emplace_back(shear);
    cells.emplace_back(SmallMatrix(shear * brick));
    if (dimension == 3) {
      shear(0, 2) = -0.7 * gamma;
      shear(1, 2) = 0.3;
      cells.emplace_back(shear);
    }
  }
  cells.emplace_back(SmallMatrix(SimpleShear(dimension, 0.3).transpose()));
  // A left-handed cell.
  SmallMatrix mirrored = SimpleShear(dimension, 1.2);
  mirrored.col(0) *= -1.0;
  cells.emplace_back(mirrored);
  for (int seed = 1; seed <= 6; ++seed) {
    cells.push_back(RandomBox(dimension, seed));
  }
  return cells;
}

// Uniform in the cell.
Eigen::MatrixXd RandomPositions(const Box& box, int n, std::uint64_t seed) {
  UniformRandom random(seed);
  Eigen::MatrixXd fractions(box.dimension(), n);
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < box.dimension(); ++k) fractions(k, i) = random();
  }
  return box.edges() * fractions;
}

// Radii 1 and 1.4, half of the grains each, covering phi of the cell.
Eigen::VectorXd BidisperseRadii(const Box& box, int n, double phi) {
  Packing packing;
  packing.box = box;
  packing.radii.resize(n);
  for (int i = 0; i < n; ++i) packing.radii[i] = i % 2 == 0 ? 1.0 : 1.4;
  packing.SetPackingFraction(phi);
  return packing.radii;
}

TEST(NeighborList, BidisperseGrainsMatchTheSumOverAllImages) {
  for (const int d : {2, 3}) {
    const int n = d == 2 ? 80 : 60;
    std::uint64_t seed = 10;
    for (const Box& box : Cells(d)) {
      SCOPED_TRACE(testing::Message() << "cell " << box.edges());
      const Eigen::VectorXd radii = BidisperseRadii(box, n, 0.7);
      const Eigen::MatrixXd x = RandomPositions(box, n, ++seed);
      for (const double skin : {0.0, 0.3 * radii.minCoeff()}) {
        EXPECT_GT(ExpectMatchesOracle(box, x, radii, skin), n / 2);
      }
    }
  }
}

TEST(NeighborList, FewLargeAmongManySmallGrainsMatchTheSumOverAllImages) {
  for (const int d : {2, 3}) {
    std::uint64_t seed = 40;
    const std::vector<Box> cells = Cells(d);
    for (const std::size_t c : {0, 2, 4, 6}) {
      const Box& box = cells[c];
      SCOPED_TRACE(testing::Message() << "cell " << box.edges());
      const int n = 300;
      Eigen::VectorXd radii = Eigen::VectorXd::Constant(n, 0.003);
      radii[7] = 0.3;  // a hundred times as large as most
      radii[100] = 0.29;
      radii[299] = 0.05;
      radii[150] = 0.006;  // exactly a factor of two: the edge of a size class
      const Eigen::MatrixXd x = RandomPositions(box, n, ++seed);
      for (const double skin : {0.0, 0.001}) {
        EXPECT_GT(ExpectMatchesOracle(box, x, radii, skin), n / 10);
      }
    }
  }
}

TEST(NeighborList, OneToThreeGrainsInShortCellsSeeAllTheirImages) {
  for (const int d : {2, 3}) {
    std::uint64_t seed = 70;
    for (const Box& box : Cells(d)) {
      Eigen::Matrix3i transform;
      const Box reduced = box.Reduced(&transform);
      double height = reduced.Height(0);
      for (int k = 1; k < d; ++k) height = std::min(height, reduced.Height(k));
      for (const int n : {1, 2, 3}) {
        // Up to four of the shortest heights from centre to centre, grains of
        // about one size or each a fifth of the one before.
        for (const double range : {0.9, 1.4, 2.2, d == 2 ? 4.0 : 2.9}) {
          for (const double ratio : {0.87, 0.2}) {
            SCOPED_TRACE(testing::Message()
                         << "cell " << box.edges() << ", " << n
                         << " grains, range " << range << ", ratio " << ratio);
            Eigen::VectorXd radii(n);
            for (int i = 0; i < n; ++i) {
              radii[i] = 0.5 * range * height * std::pow(ratio, i);
            }
            const int pairs = ExpectMatchesOracle(
                box, RandomPositions(box, n, ++seed), radii, 0.05 * radii[0]);
            if (range > 1.0) {
              EXPECT_GE(pairs, 1) << "a grain touches itself";
            }
          }
        }
      }
    }
  }
}

TEST(NeighborList, PositionsMayLieInAnyImage) {
  for (const int d : {2, 3}) {
    std::uint64_t seed = 100;
    for (const Box& box : Cells(d)) {
      SCOPED_TRACE(testing::Message() << "cell " << box.edges());
      const int n = 30;
      const Eigen::VectorXd radii = BidisperseRadii(box, n, 0.8);
      const Eigen::MatrixXd inside = RandomPositions(box, n, ++seed);
      Eigen::MatrixXd x = inside;
      UniformRandom random(seed);
      for (int i = 0; i < n; ++i) {
        for (int k = 0; k < d; ++k) {
          x.col(i) += std::floor(11.0 * random() - 5.0) * box.edges().col(k);
        }
      }
      const double skin = 0.1 * radii.minCoeff();
      EXPECT_EQ(ExpectMatchesOracle(box, x, radii, skin),
                ExpectMatchesOracle(box, inside, radii, skin));
    }
  }
}

// Positions on the faces of the cell and on the borders of the grid, distances
// that agree with the range to the last digit.
TEST(NeighborList, LatticesOnTheBordersOfTheGridMatchTheSumOverAllImages) {
  for (const int repeat : {1, 2, 4, 5}) {
    const Packing square =
        BravaisLattice(SmallMatrix::Identity(2, 2), {repeat, repeat}, 0.5);
    const Packing cubic = BravaisLattice(
        SmallMatrix::Identity(3, 3), {repeat, repeat, repeat}, 0.5);
    const Packing hexagonal =
        BravaisLattice(HexagonalCell(1.0), {repeat, repeat}, 0.51);
    const Packing fcc =
        BravaisLattice(FccCell(1.0), {repeat, repeat, repeat}, 0.51);
    for (const Packing* packing : {&square, &cubic, &hexagonal, &fcc}) {
      for (const double skin : {0.0, 0.25, 0.5}) {
        const int pairs = ExpectMatchesOracle(
            packing->box, packing->positions, packing->radii, skin);
        if (skin == 0.25) {
          const int contacts = packing == &square ? 2 : packing == &fcc ? 6 : 3;
          EXPECT_EQ(pairs, contacts * packing->size());
        }
      }
    }
  }
}

TEST(NeighborList, HugeShearsOfTheSameLatticeGiveTheSamePairs) {
  const int n = 40;
  const Box unit = Box::Cube(2, 1.0);
  const Eigen::MatrixXd x = RandomPositions(unit, n, 5);
  const Eigen::VectorXd radii = BidisperseRadii(unit, n, 0.8);
  const int expected = ExpectMatchesOracle(unit, x, radii, 0.01);
  for (const double gamma : {1.0, -7.0, 4096.0, -9000.0}) {
    NeighborList list;
    std::string error;
    ASSERT_TRUE(BuildNeighborList(
        Box(SimpleShear(2, gamma)), x, radii, 0.01, &list, &error))
        << "gamma = " << gamma << ": " << error;
    ExpectCanonical(list, n, 2);
    EXPECT_EQ(list.num_pairs(), expected) << "gamma = " << gamma;
  }
}

TEST(NeighborList, RefusesACellOfWhichTooManyImagesAreNeeded) {
  for (const int d : {2, 3}) {
    for (int thin = 0; thin < d; ++thin) {
      SmallMatrix edges = SmallMatrix::Identity(d, d);
      for (int k = 0; k < d; ++k) edges(k, k) = k == thin ? 1.0 : 20.0;
      const Eigen::MatrixXd x = Eigen::MatrixXd::Constant(d, 1, 0.3);
      // A range of 8.02 heights is refused, 7.98 is served.
      NeighborList list;
      std::string error;
      EXPECT_FALSE(BuildNeighborList(Box(edges),
                                     x,
                                     Eigen::VectorXd::Constant(1, 4.0),
                                     0.02,
                                     &list,
                                     &error));
      EXPECT_NE(error.find("grain 0"), std::string::npos) << error;
      EXPECT_NE(error.find(std::to_string(kMaxImages) + " images"),
                std::string::npos)
          << error;
      EXPECT_NE(error.find("8.02"), std::string::npos) << error;
      EXPECT_EQ(error.find('\n'), std::string::npos) << "one line";
      EXPECT_EQ(ExpectMatchesOracle(
                    Box(edges), x, Eigen::VectorXd::Constant(1, 3.98), 0.02),
                7);
    }
  }
}

}  // namespace
}  // namespace granopt
