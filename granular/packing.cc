#include "granular/packing.h"

#include <cmath>

#include "solvers/format.h"
#include "solvers/random.h"

namespace granopt {
namespace {

constexpr double kPi = 3.14159265358979323846;

std::string GrainError(int i, const char* what, double value) {
  return Format("grain %d: %s = %.17g ", i, what, value);
}

}  // namespace

double GrainVolume(int dimension, double radius) {
  return dimension == 2 ? kPi * radius * radius
                        : 4.0 / 3.0 * kPi * radius * radius * radius;
}

bool Packing::IsValid(std::string* error) const {
  const int n = size();
  const int d = dimension();
  const auto fail = [error](const std::string& line) {
    *error = line;
    return false;
  };
  if (n == 0) return fail("the packing has no grains");
  if (!box.IsValid()) return fail("the cell is singular or not finite");
  const bool sizes_agree =
      positions.rows() == d && positions.cols() == n &&
      (positions_low.size() == 0 ||
       (positions_low.rows() == d && positions_low.cols() == n)) &&
      (stiffness.size() == 0 || stiffness.size() == n) &&
      (species.empty() || static_cast<int>(species.size()) == n);
  if (!sizes_agree) return fail("arrays of different lengths");
  for (int i = 0; i < n; ++i) {
    for (int k = 0; k < d; ++k) {
      const DoubleDouble x = Position(i, k);
      if (!std::isfinite(x.hi) || !std::isfinite(x.lo)) {
        return fail(GrainError(i, "position", x.hi) + "is not finite");
      }
    }
    // Beyond 1e6 cells the image numbers lose their meaning.
    for (int k = 0; k < d; ++k) {
      double cells = 0.0;
      for (int c = 0; c < d; ++c)
        cells += box.inverse()(k, c) * positions(c, i);
      if (!(std::abs(cells) <= 1e6)) {
        return fail(GrainError(i, "position in cells", cells) +
                    "is far outside");
      }
    }
    if (!(radii[i] > 0.0) || !std::isfinite(radii[i])) {
      return fail(GrainError(i, "radius", radii[i]) + "must be positive");
    }
    if (stiffness.size() > 0 &&
        (!(stiffness[i] > 0.0) || !std::isfinite(stiffness[i]))) {
      return fail(GrainError(i, "stiffness", stiffness[i]) +
                  "must be positive");
    }
  }
  return true;
}

double Packing::PackingFraction() const {
  double sum = 0.0;
  for (int i = 0; i < size(); ++i) sum += GrainVolume(dimension(), radii[i]);
  return sum / box.Volume();
}

double Packing::MeanRadius() const { return radii.sum() / size(); }

void Packing::ScaleRadii(double factor) { radii *= factor; }

void Packing::SetPackingFraction(double phi) {
  ScaleRadii(std::pow(phi / PackingFraction(), 1.0 / dimension()));
}

void Packing::Deform(const SmallMatrix& deformation) {
  const int d = dimension();
  for (int i = 0; i < size(); ++i) {
    DoubleDouble image[3];
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        image[r] = image[r] + Position(i, c) * DoubleDouble(deformation(r, c));
      }
    }
    for (int r = 0; r < d; ++r) SetPosition(i, r, image[r]);
  }
  box = box.Deformed(deformation);
}

void Packing::Perturb(double amplitude, std::uint64_t seed) {
  UniformRandom random(seed);
  for (int i = 0; i < size(); ++i) {
    for (int k = 0; k < dimension(); ++k) {
      SetPosition(
          i, k, Position(i, k) + DoubleDouble(amplitude * (2 * random() - 1)));
    }
  }
}

Packing Packing::Copies(int n) const {
  const int d = dimension();
  int count = 1;
  for (int k = 0; k < d; ++k) count *= n;
  Packing all;
  all.box = Box(n * box.edges());
  all.attributes = attributes;
  all.radii = radii.replicate(count, 1);
  all.stiffness = stiffness.replicate(count, 1);
  all.positions = positions.replicate(1, count);
  all.positions_low = positions_low.replicate(1, count);
  all.species.reserve(species.size() * count);
  for (int copy = 0; copy < count; ++copy) {
    all.species.insert(all.species.end(), species.begin(), species.end());
    int place[3], rest = copy;
    for (int k = d - 1; k >= 0; --k) {
      place[k] = rest % n;
      rest /= n;
    }
    if (copy == 0) continue;
    for (int i = 0; i < size(); ++i) {
      for (int k = 0; k < d; ++k) {
        DoubleDouble x = Position(i, k);
        for (int c = 0; c < d; ++c) {
          if (place[c] != 0) x = x + TwoProduct(place[c], box.edges()(k, c));
        }
        all.SetPosition(copy * size() + i, k, x);
      }
    }
  }
  return all;
}

std::vector<Image> Packing::Wrap() {
  const int d = dimension();
  std::vector<Image> moved_by(size());
  for (int i = 0; i < size(); ++i) {
    const Image n = box.CellOf(positions.col(i).data());
    for (int k = 0; k < d; ++k) {
      DoubleDouble x = Position(i, k);
      bool moved = false;
      for (int c = 0; c < d; ++c) {
        if (n[c] == 0) continue;
        x = x - TwoProduct(n[c], box.edges()(k, c));
        moved = true;
      }
      if (moved) SetPosition(i, k, x);
    }
    moved_by[i] = n;
  }
  return moved_by;
}

bool Packing::Fold(Eigen::Matrix3i* transform) {
  const Box reduced = box.Reduced(transform);
  if (*transform == Eigen::Matrix3i::Identity()) return false;
  box = reduced;
  Wrap();
  return true;
}

SmallMatrix SimpleShear(int dimension, double gamma) {
  SmallMatrix d = SmallMatrix::Identity(dimension, dimension);
  d(0, 1) = gamma;
  return d;
}

SmallMatrix PureShear(int dimension, double gamma) {
  SmallMatrix d = SmallMatrix::Identity(dimension, dimension);
  d(0, 0) = 1.0 + gamma;
  d(1, 1) = 1.0 / (1.0 + gamma);
  return d;
}

}  // namespace granopt
