#include "granular/cell_energy.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "Eigen/LU"
#include "granular/double_double.h"
#include "solvers/format.h"

namespace granopt {
namespace {

// Entries of eps beyond this are no strain of a packing any more.
constexpr double kMaxStrain = 4.0;

// det(1 + eps) - 1 without cancellation.
double VolumeStrain(const SmallMatrix& eps) {
  const double trace = eps.trace();
  const double second = 0.5 * (trace * trace - (eps * eps).trace());
  return eps.rows() == 2 ? trace + second : trace + second + eps.determinant();
}

}  // namespace

std::vector<SmallMatrix> IsotropicStrain(int d) {
  return {SmallMatrix::Identity(d, d)};
}

std::vector<SmallMatrix> VolumePreservingStrains(int d) {
  std::vector<SmallMatrix> strains;
  for (int k = 1; k < d; ++k) {
    SmallMatrix m = SmallMatrix::Zero(d, d);
    m(k - 1, k - 1) = 1.0;
    m(k, k) = -1.0;
    strains.push_back(m);
  }
  for (int r = 0; r < d; ++r) {
    for (int c = r + 1; c < d; ++c) {
      SmallMatrix m = SmallMatrix::Zero(d, d);
      m(r, c) = m(c, r) = 1.0;
      strains.push_back(m);
    }
  }
  return strains;
}

std::vector<SmallMatrix> AllStrains(int d) {
  std::vector<SmallMatrix> strains = IsotropicStrain(d);
  for (const SmallMatrix& m : VolumePreservingStrains(d)) strains.push_back(m);
  return strains;
}

std::vector<SmallMatrix> SimpleShearStrain(int d) {
  SmallMatrix m = SmallMatrix::Zero(d, d);
  m(0, 1) = 1.0;
  return {m};
}

CellEnergy::CellEnergy(const Packing& packing, const CellEnergyOptions& options)
    : options_(options),
      dimension_(packing.dimension()),
      num_grains_(packing.size()),
      num_coordinates_(dimension_ * num_grains_),
      num_strains_(static_cast<int>(options.strains.size())),
      packing_(packing),
      mean_radius_(packing.MeanRadius()),
      min_radius_(packing.radii.minCoeff()),
      max_radius_(packing.radii.maxCoeff()),
      strain_length_(mean_radius_ * std::sqrt(num_grains_)),
      volume_(packing.box.Volume()),
      list_(min_radius_),
      x_list_(NumParameters(), 0.0),
      x_reference_(NumParameters(), 0.0),
      strain_reference_(SmallMatrix::Zero(dimension_, dimension_)) {}

std::unique_ptr<CellEnergy> CellEnergy::Create(const Packing& packing,
                                               const CellEnergyOptions& options,
                                               std::string* error) {
  if (!options.energy.fixed.empty()) {
    *error = "grains cannot be fixed in a cell that moves";
    return nullptr;
  }
  ContactEnergyOptions energy_options = options.energy;
  energy_options.precision = Precision::DOUBLE;
  std::unique_ptr<ContactEnergy> law =
      ContactEnergy::Create(packing, energy_options, error);
  if (law == nullptr) return nullptr;
  const int d = packing.dimension();
  for (const SmallMatrix& m : options.strains) {
    if (m.rows() == d && m.cols() == d && m.allFinite()) continue;
    *error = Format("a strain must be %d x %d and finite", d, d);
    return nullptr;
  }
  const SmallMatrix& s = options.load;
  if (s.size() > 0 && !(s.rows() == d && s.cols() == d && s.allFinite())) {
    *error = Format("the load must be %d x %d and finite", d, d);
    return nullptr;
  }
  if (!std::isfinite(options.pressure)) {
    *error = Format("pressure = %g must be finite", options.pressure);
    return nullptr;
  }
  std::unique_ptr<CellEnergy> function(new CellEnergy(packing, options));
  function->law_ = std::move(law);
  Point point;
  const std::vector<double> zero(function->NumParameters(), 0.0);
  point.strain = SmallMatrix::Zero(d, d);
  point.f = SmallMatrix::Identity(d, d);
  if (!function->BuildList(zero.data(), point, error)) return nullptr;
  return function;
}

SmallMatrix CellEnergy::Strain(const double* x) const {
  SmallMatrix eps = SmallMatrix::Zero(dimension_, dimension_);
  for (int m = 0; m < num_strains_; ++m) {
    eps += (x[num_coordinates_ + m] / strain_length_) * options_.strains[m];
  }
  return eps;
}

bool CellEnergy::BuildList(const double* x,
                           const Point& point,
                           std::string* error) const {
  const Eigen::Map<const Eigen::MatrixXd> u(x, dimension_, num_grains_);
  const Eigen::MatrixXd positions = point.f * (packing_.positions + u);
  const Box box = packing_.box.Deformed(point.f);
  if (!box.IsValid()) {
    *error = "the cell has become singular";
    return false;
  }
  if (!list_.Renew(box, positions, packing_.radii, error)) return false;
  pairs_.assign(list_.num_pairs(), Pair());
  for (int p = 0; p < list_.num_pairs(); ++p) {
    Pair& pair = pairs_[p];
    pair.i = list_.i[p];
    pair.j = list_.j[p];
    pair.stiffness = PairStiffness(packing_, options_.energy, pair.i, pair.j);
  }
  std::copy(x, x + NumParameters(), x_list_.begin());
  f_list_ = point.f;
  SetReference();
  return true;
}

void CellEnergy::SetReference() const {
  const int d = dimension_;
  std::vector<DoubleDouble> position(num_coordinates_);
  for (int i = 0; i < num_grains_; ++i) {
    for (int k = 0; k < d; ++k) {
      position[d * i + k] = packing_.Position(i, k) + x_reference_[d * i + k];
    }
  }
  for (int p = 0; p < list_.num_pairs(); ++p) {
    Pair& pair = pairs_[p];
    DoubleDouble before[3], square;
    for (int k = 0; k < d; ++k) {
      before[k] = position[d * pair.i + k] - position[d * pair.j + k];
      for (int c = 0; c < d; ++c) {
        const int n = list_.image[p][c];
        if (n != 0) {
          before[k] = before[k] + TwoProduct(n, packing_.box.edges()(k, c));
        }
      }
      pair.before[k] = before[k].hi;
    }
    for (int k = 0; k < d; ++k) {
      DoubleDouble r = before[k];
      for (int c = 0; c < d; ++c) {
        r = r + before[c] * DoubleDouble(strain_reference_(k, c));
      }
      pair.r0[k] = r.hi;
      square = square + r * r;
    }
    const DoubleDouble distance = Sqrt(square);
    pair.d0 =
        std::max(distance.hi, std::ldexp(1.0, std::ilogb(min_radius_) - 300));
    pair.delta0 =
        (TwoSum(packing_.radii[pair.i], packing_.radii[pair.j]) - distance)
            .Value();
  }
}

bool CellEnergy::Prepare(const double* x, Point* point) const {
  double most = 0.0;
  for (int v = 0; v < NumParameters(); ++v) {
    if (!std::isfinite(x[v])) return false;
    if (v < num_coordinates_) most = std::max(most, std::abs(x[v]));
  }
  if (most > kMaxCells * packing_.box.Length()) return false;
  point->strain = Strain(x);
  if (!(point->strain.cwiseAbs().maxCoeff() <= kMaxStrain)) return false;
  point->f = SmallMatrix::Identity(dimension_, dimension_) + point->strain;
  if (!(point->f.determinant() > 0.0)) return false;
  list_.CountEvaluation();
  // A pair that was further apart than its range and the skin then is r, with
  // |F F_list^-1 - 1| = eta, now at least |r| (1 - eta) - 2 |F (u - u_list)|.
  double moved2 = 0.0;
  for (int i = 0; i < num_grains_; ++i) {
    double w[3] = {}, square = 0.0;
    for (int k = 0; k < dimension_; ++k) {
      w[k] = x[dimension_ * i + k] - x_list_[dimension_ * i + k];
    }
    for (int r = 0; r < dimension_; ++r) {
      double v = 0.0;
      for (int c = 0; c < dimension_; ++c) v += point->f(r, c) * w[c];
      square += v * v;
    }
    moved2 = std::max(moved2, square);
  }
  const SmallMatrix change = point->f * f_list_.inverse() -
                             SmallMatrix::Identity(dimension_, dimension_);
  const double eta = change.norm();
  if (eta > 0.5 ||
      2.0 * std::sqrt(moved2) + eta * (2.0 * max_radius_ + list_.skin()) >
          list_.usable_skin()) {
    std::string error;
    if (!BuildList(x, *point, &error)) return false;
  }
  return true;
}

bool CellEnergy::Evaluate(const Pair& pair,
                          const double* x,
                          const Point& point,
                          PairState* state) const {
  const int d = dimension_;
  double w[3], s[3], dot = 0.0, square = 0.0, distance2 = 0.0;
  for (int k = 0; k < d; ++k) {
    const int i = d * pair.i + k, j = d * pair.j + k;
    w[k] = (x[i] - x_reference_[i]) - (x[j] - x_reference_[j]);
    state->before[k] = pair.before[k] + w[k];
  }
  for (int r = 0; r < d; ++r) {
    s[r] = 0.0;
    for (int c = 0; c < d; ++c) {
      s[r] += (point.strain(r, c) - strain_reference_(r, c)) * pair.before[c] +
              point.f(r, c) * w[c];
    }
    dot += pair.r0[r] * s[r];
    square += s[r] * s[r];
    const double sum = pair.r0[r] + s[r];
    distance2 += sum * sum;
  }
  state->distance = std::sqrt(distance2);
  state->delta =
      pair.delta0 - (2.0 * dot + square) / (state->distance + pair.d0);
  last_move_ = std::max(last_move_, square);
  if (!(state->delta > 0.0)) return false;
  law_->EvaluateLaw(1, &state->delta, &state->force, &state->stiffness);
  state->force *= pair.stiffness;
  state->stiffness *= pair.stiffness;
  // Centres that coincide have no direction.
  const double inverse = state->distance > 0.0 ? 1.0 / state->distance : 0.0;
  for (int k = 0; k < d; ++k) state->n[k] = (pair.r0[k] + s[k]) * inverse;
  return true;
}

template <typename Function>
void CellEnergy::ForContacts(const double* x,
                             const Point& point,
                             const Function& f) const {
  last_move_ = 0.0;
  PairState state;
  for (const Pair& pair : pairs_) {
    if (Evaluate(pair, x, point, &state)) f(pair, state);
  }
}

bool CellEnergy::EvaluateWithScales(const double* x,
                                    double* enthalpy,
                                    double* gradient,
                                    Scales* scales) const {
  const int d = dimension_;
  Point point;
  if (!Prepare(x, &point)) return false;
  const double alpha = options_.energy.alpha;
  double energy = 0.0, force = 0.0, overlap = 0.0, virial = 0.0;
  std::int64_t contacts = 0;
  SmallMatrix tension = SmallMatrix::Zero(d, d);  // sum f n (x) R
  if (gradient != nullptr) std::fill(gradient, gradient + NumParameters(), 0.0);
  ForContacts(x, point, [&](const Pair& pair, const PairState& s) {
    // f = k delta^(alpha-1).
    energy += s.force * s.delta / alpha;
    force += s.force;
    overlap += s.delta;
    virial += s.force * s.distance;
    ++contacts;
    if (gradient == nullptr) return;
    for (int c = 0; c < d; ++c) {
      double pull = 0.0;
      for (int r = 0; r < d; ++r) {
        pull += point.f(r, c) * s.n[r];
        tension(r, c) += s.force * s.n[r] * s.before[c];
      }
      pull *= s.force;
      gradient[d * pair.i + c] -= pull;
      gradient[d * pair.j + c] += pull;
    }
  });
  last_overlap_ = contacts > 0 ? overlap / static_cast<double>(contacts) : 0.0;
  const double pressure = options_.pressure;
  *enthalpy = energy + pressure * volume_ * VolumeStrain(point.strain);
  const bool has_load = options_.load.size() > 0;
  if (has_load) {
    *enthalpy += volume_ * options_.load.cwiseProduct(point.strain).sum();
  }
  if (gradient != nullptr && num_strains_ > 0) {
    const double volume = volume_ * (1.0 + VolumeStrain(point.strain));
    SmallMatrix conjugate =
        pressure * volume * point.f.inverse().transpose() - tension;
    if (has_load) conjugate += volume_ * options_.load;
    for (int m = 0; m < num_strains_; ++m) {
      gradient[num_coordinates_ + m] =
          conjugate.cwiseProduct(options_.strains[m]).sum() / strain_length_;
    }
  }
  if (scales != nullptr) {
    *scales = Scales();
    const double radius = mean_radius_;
    if (contacts > 0) {
      scales->gradient = force / static_cast<double>(contacts);
      scales->length = last_overlap_ / (alpha - 1.0);
    } else {
      scales->gradient = std::abs(pressure) * std::pow(2.0 * radius, d - 1);
      scales->length = radius;
    }
    const bool is_loaded =
        pressure != 0.0 || (has_load && !options_.load.isZero(0.0));
    if (!is_loaded) {
      const double volume = volume_ * (1.0 + VolumeStrain(point.strain));
      const double p = virial / (d * volume);
      scales->vanishing = std::max(std::pow(p / (options_.energy.stiffness *
                                                 std::pow(radius, alpha - d)),
                                            1.0 / (alpha - 1.0)),
                                   last_overlap_ / radius);
    }
  }
  return std::isfinite(*enthalpy);
}

bool CellEnergy::Recenter(const double* x) {
  if (last_overlap_ > 0.0 && last_move_ <= kRecenterOverlaps *
                                               kRecenterOverlaps *
                                               last_overlap_ * last_overlap_) {
    return false;
  }
  Point point;
  if (!Prepare(x, &point)) return false;
  std::copy(x, x + NumParameters(), x_reference_.begin());
  strain_reference_ = point.strain;
  SetReference();
  return true;
}

void CellEnergy::UpdatePattern(const double* x, const Point& point) const {
  const int d = dimension_;
  std::vector<char> wanted(pairs_.size(), 0);
  const double margin = kPatternMargin * min_radius_;
  bool is_current = pattern_list_version_ == list_.version();
  last_move_ = 0.0;
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    PairState state;
    const bool is_closed = Evaluate(pairs_[p], x, point, &state);
    wanted[p] = state.delta > -margin ? 1 : 0;
    if (is_closed && pairs_[p].i != pairs_[p].j && pairs_[p].rank < 0) {
      is_current = false;
    }
  }
  if (is_current) return;
  pattern_list_version_ = list_.version();
  ++pattern_version_;
  blocks_.assign(num_grains_, 0);
  std::vector<std::vector<int>> neighbours(num_grains_);
  for (std::size_t p = 0; p < pairs_.size(); ++p) {
    Pair& pair = pairs_[p];
    pair.rank = -1;
    if (wanted[p] == 0 || pair.i == pair.j) continue;
    // Pairs are sorted by (i, j, image).
    std::vector<int>& of = neighbours[pair.i];
    if (of.empty() || of.back() != pair.j) of.push_back(pair.j);
    pair.rank = static_cast<int>(of.size()) - 1;
  }
  column_start_.assign(NumParameters() + 1, 0);
  rows_.clear();
  for (int i = 0; i < num_grains_; ++i) {
    blocks_[i] = static_cast<int>(neighbours[i].size());
    for (int c = 0; c < d; ++c) {
      column_start_[d * i + c] = static_cast<int>(rows_.size());
      for (int r = c; r < d; ++r) rows_.push_back(d * i + r);
      for (const int j : neighbours[i]) {
        for (int r = 0; r < d; ++r) rows_.push_back(d * j + r);
      }
      for (int m = 0; m < num_strains_; ++m) {
        rows_.push_back(num_coordinates_ + m);
      }
    }
  }
  for (int m = 0; m < num_strains_; ++m) {
    column_start_[num_coordinates_ + m] = static_cast<int>(rows_.size());
    for (int r = m; r < num_strains_; ++r) {
      rows_.push_back(num_coordinates_ + r);
    }
  }
  column_start_[NumParameters()] = static_cast<int>(rows_.size());
}

void CellEnergy::AddLoad(const Point& point, Eigen::MatrixXd* block) const {
  const double volume = volume_ * (1.0 + VolumeStrain(point.strain));
  const SmallMatrix inverse = point.f.inverse();
  const double l2 = strain_length_ * strain_length_;
  for (int m = 0; m < num_strains_; ++m) {
    const SmallMatrix a = inverse * options_.strains[m];
    for (int n = 0; n < num_strains_; ++n) {
      const SmallMatrix b = inverse * options_.strains[n];
      (*block)(m, n) += options_.pressure * volume *
                        (a.trace() * b.trace() - (a * b).trace()) / l2;
    }
  }
}

bool CellEnergy::EvaluateHessian(const double* x, SparseMatrix* hessian) const {
  const int d = dimension_;
  Point point;
  if (!Prepare(x, &point)) return false;
  UpdatePattern(x, point);
  const int n = NumParameters();
  hessian->resize(n, n);
  hessian->resizeNonZeros(column_start_[n]);
  std::copy(
      column_start_.begin(), column_start_.end(), hessian->outerIndexPtr());
  std::copy(rows_.begin(), rows_.end(), hessian->innerIndexPtr());
  double* const value = hessian->valuePtr();
  std::fill(value, value + column_start_[n], 0.0);
  Eigen::MatrixXd cell = Eigen::MatrixXd::Zero(num_strains_, num_strains_);
  ForContacts(x, point, [&](const Pair& pair, const PairState& s) {
    const double side = s.distance > 0.0 ? s.force / s.distance : 0.0;
    double k[3][3], fk[3][3], fkf[3][3];
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        k[r][c] =
            (s.stiffness + side) * s.n[r] * s.n[c] - (r == c ? side : 0.0);
      }
    }
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        fk[r][c] = 0.0;
        for (int m = 0; m < d; ++m) fk[r][c] += point.f(m, r) * k[m][c];
      }
    }
    for (int r = 0; r < d; ++r) {
      for (int c = 0; c < d; ++c) {
        fkf[r][c] = 0.0;
        for (int m = 0; m < d; ++m) fkf[r][c] += fk[r][m] * point.f(m, c);
      }
    }
    double moved[6][3];  // M_m R
    for (int m = 0; m < num_strains_; ++m) {
      for (int r = 0; r < d; ++r) {
        moved[m][r] = 0.0;
        for (int c = 0; c < d; ++c) {
          moved[m][r] += options_.strains[m](r, c) * s.before[c];
        }
        moved[m][r] /= strain_length_;
      }
    }
    for (int m = 0; m < num_strains_; ++m) {
      double km[3];
      for (int r = 0; r < d; ++r) {
        km[r] = 0.0;
        for (int c = 0; c < d; ++c) km[r] += k[r][c] * moved[m][c];
      }
      for (int o = 0; o < num_strains_; ++o) {
        for (int r = 0; r < d; ++r) cell(o, m) += moved[o][r] * km[r];
      }
      if (pair.i == pair.j) continue;
      for (int c = 0; c < d; ++c) {
        double cross = 0.0;
        for (int r = 0; r < d; ++r) {
          cross += fk[c][r] * moved[m][r] - s.force *
                                                options_.strains[m](r, c) *
                                                s.n[r] / strain_length_;
        }
        for (const auto& [grain, sign] :
             {std::make_pair(pair.i, 1.0), std::make_pair(pair.j, -1.0)}) {
          value[column_start_[d * grain + c] + (d - c) + d * blocks_[grain] +
                m] += sign * cross;
        }
      }
    }
    if (pair.i == pair.j) return;
    for (int c = 0; c < d; ++c) {
      for (const int grain : {pair.i, pair.j}) {
        double* const own = value + column_start_[d * grain + c];
        for (int r = c; r < d; ++r) own[r - c] += fkf[r][c];
      }
      double* const block =
          value + column_start_[d * pair.i + c] + (d - c) + d * pair.rank;
      for (int r = 0; r < d; ++r) block[r] -= fkf[r][c];
    }
  });
  AddLoad(point, &cell);
  for (int m = 0; m < num_strains_; ++m) {
    for (int r = m; r < num_strains_; ++r) {
      value[column_start_[num_coordinates_ + m] + r - m] += cell(r, m);
    }
  }
  return true;
}

bool CellEnergy::HessianTimes(const double* x,
                              const double* v,
                              double* hv) const {
  const int d = dimension_;
  Point point;
  if (!Prepare(x, &point)) return false;
  std::fill(hv, hv + NumParameters(), 0.0);
  SmallMatrix rate = SmallMatrix::Zero(d, d);
  for (int m = 0; m < num_strains_; ++m) {
    rate += (v[num_coordinates_ + m] / strain_length_) * options_.strains[m];
  }
  SmallMatrix sum = SmallMatrix::Zero(d, d);
  ForContacts(x, point, [&](const Pair& pair, const PairState& s) {
    const double side = s.distance > 0.0 ? s.force / s.distance : 0.0;
    // dr = rate R + F dw, and what the force does to it.
    double dw[3], dr[3], dot = 0.0, kr[3];
    for (int k = 0; k < d; ++k) dw[k] = v[d * pair.i + k] - v[d * pair.j + k];
    for (int r = 0; r < d; ++r) {
      dr[r] = 0.0;
      for (int c = 0; c < d; ++c) {
        dr[r] += rate(r, c) * s.before[c] + point.f(r, c) * dw[c];
      }
      dot += s.n[r] * dr[r];
    }
    for (int r = 0; r < d; ++r) {
      kr[r] = (s.stiffness + side) * s.n[r] * dot - side * dr[r];
    }
    for (int c = 0; c < d; ++c) {
      double pull = 0.0;
      for (int r = 0; r < d; ++r) {
        pull += point.f(r, c) * kr[r] - rate(r, c) * s.force * s.n[r];
        sum(r, c) += kr[r] * s.before[c] - s.force * s.n[r] * dw[c];
      }
      hv[d * pair.i + c] += pull;
      hv[d * pair.j + c] -= pull;
    }
  });
  Eigen::MatrixXd load = Eigen::MatrixXd::Zero(num_strains_, num_strains_);
  AddLoad(point, &load);
  for (int m = 0; m < num_strains_; ++m) {
    double& to = hv[num_coordinates_ + m];
    to = sum.cwiseProduct(options_.strains[m]).sum() / strain_length_;
    for (int n = 0; n < num_strains_; ++n) {
      to += load(m, n) * v[num_coordinates_ + n];
    }
  }
  return true;
}

Packing CellEnergy::Configuration(const double* x) const {
  Packing result = packing_;
  const SmallMatrix eps = Strain(x);
  const int d = dimension_;
  for (int i = 0; i < num_grains_; ++i) {
    DoubleDouble before[3];
    for (int k = 0; k < d; ++k) {
      before[k] = packing_.Position(i, k) + x[d * i + k];
    }
    for (int r = 0; r < d; ++r) {
      DoubleDouble y = before[r];
      for (int c = 0; c < d; ++c) y = y + before[c] * DoubleDouble(eps(r, c));
      result.SetPosition(i, r, y);
    }
  }
  result.box = packing_.box.Deformed(SmallMatrix::Identity(d, d) + eps);
  return result;
}

}  // namespace granopt
