#include "experiments/shear_curves.h"

#include <algorithm>
#include <cmath>

#include "experiments/tabular.h"

namespace granopt {

static void Columns(StrainRow* row, CsvColumns* columns) {
  columns->Add("increment", &row->increment);
  columns->Add("step", &row->step);
  columns->Add("strain", &row->strain);
  columns->Add("energy", &row->energy);
  columns->Add("work", &row->work);
  columns->Add("dissipated", &row->dissipated);
  columns->Add("stress_iso", &row->stress_iso);
  columns->Add("stress_dev", &row->stress_dev);
  columns->Add("fabric_iso", &row->fabric_iso);
  columns->Add("fabric_dev", &row->fabric_dev);
  columns->Add("conjugate", &row->conjugate);
  columns->Add("pressure", &row->pressure);
  columns->Add("shear_stress", &row->shear_stress);
  columns->Add("phi", &row->phi);
  columns->Add("coordination", &row->coordination);
  columns->Add("contacts", &row->contacts);
  columns->Add("rattlers", &row->rattlers);
  columns->Add("iterations", &row->iterations);
  columns->Add("evaluations", &row->evaluations);
  columns->Add("residual", &row->residual, 6);
  columns->Add("converged", &row->converged);
}

namespace {

// The curves of one increment each, in order.
std::vector<std::vector<StrainRow>> CurvesOf(
    const std::vector<StrainRow>& rows) {
  std::vector<std::vector<StrainRow>> curves;
  for (const StrainRow& row : rows) {
    if (row.step == 0 || curves.empty()) curves.emplace_back();
    curves.back().push_back(row);
  }
  return curves;
}

}  // namespace

StrainRow RowOf(double increment,
                DeformationMode mode,
                const QuasistaticShearStep& step) {
  const Observables& o = step.result->observables;
  StrainRow row;
  row.increment = increment;
  row.step = step.step;
  row.strain = step.strain;
  row.energy = o.energy;
  row.work = step.work;
  row.dissipated = step.dissipated;
  row.stress_iso = o.stress_parts.isotropic;
  row.stress_dev = o.stress_parts.deviatoric;
  row.fabric_iso = o.fabric_parts.isotropic;
  row.fabric_dev = o.fabric_parts.deviatoric;
  row.conjugate = ConjugateStress(mode, o.stress);
  row.pressure = o.pressure;
  row.shear_stress = o.shear_stress;
  row.phi = o.packing_fraction;
  row.coordination = o.coordination;
  row.contacts = o.contacts;
  row.rattlers = o.rattlers;
  row.residual = o.relative_residual;
  if (step.step > 0) {
    row.iterations = step.result->summary.counters.iterations;
    row.evaluations = step.result->summary.counters.evaluations;
    row.converged = step.result->summary.Succeeded() ? 1 : 0;
  }
  return row;
}

std::string CurvesCsv(const std::vector<StrainRow>& rows) {
  return FormatCsv(rows);
}

bool ParseCurves(const std::string& csv,
                 std::vector<StrainRow>* rows,
                 std::string* error) {
  return ParseCsv(csv, "curves.csv", rows, error);
}

std::vector<Agreement> CompareIncrements(const std::vector<StrainRow>& rows) {
  const std::vector<std::vector<StrainRow>> curves = CurvesOf(rows);
  std::vector<Agreement> all;
  if (curves.size() < 2) return all;
  const std::vector<StrainRow>& finest = curves.back();
  // On a path that turns a strain does not say which state is meant.
  for (std::size_t k = 2; k < finest.size(); ++k) {
    if ((finest[k].strain - finest[k - 1].strain) *
            (finest[k - 1].strain - finest[k - 2].strain) <
        0.0) {
      return all;
    }
  }
  double most = 0.0, most_fabric = 0.0;
  for (const StrainRow& row : finest) {
    most = std::max(most, row.stress_dev);
    most_fabric = std::max(most_fabric, row.fabric_dev);
  }
  // Nothing to compare with without forces.
  if (!(most > 0.0)) return all;
  const double end = std::abs(finest.back().strain);
  for (std::size_t k = 0; k + 1 < curves.size(); ++k) {
    Agreement a;
    a.increment = curves[k].front().increment;
    a.finest = finest.front().increment;
    int few = 0, many = 0;
    bool agrees = true;
    std::size_t at = 0;
    for (const StrainRow& row : curves[k]) {
      while (at < finest.size() &&
             std::abs(finest[at].strain) < std::abs(row.strain) - 1e-9 * end) {
        ++at;
      }
      if (row.step == 0 || at == finest.size() ||
          std::abs(finest[at].strain - row.strain) > 1e-9 * end) {
        continue;
      }
      const double stress =
          std::abs(row.stress_dev - finest[at].stress_dev) / most;
      const double fabric =
          std::abs(row.fabric_dev - finest[at].fabric_dev) / most_fabric;
      agrees = agrees && stress < 0.01;
      if (agrees) a.agrees_until = std::abs(row.strain);
      ++many;
      a.all += stress;
      a.all_fabric += fabric;
      if (std::abs(row.strain) <= 0.1 * end * (1.0 + 1e-9)) {
        ++few;
        a.small_strain += stress;
        a.small_strain_fabric += fabric;
      }
    }
    a.all /= std::max(1, many);
    a.all_fabric /= std::max(1, many);
    a.small_strain /= std::max(1, few);
    a.small_strain_fabric /= std::max(1, few);
    all.push_back(a);
  }
  return all;
}

std::string AgreementCsv(const std::vector<Agreement>& agreement) {
  std::string csv =
      "increment,finest,small_strain,all,agrees_until,small_strain_fabric,"
      "all_fabric\n";
  for (const Agreement& a : agreement) {
    csv += Format("%g,%g,%.6g,%.6g,%.6g,%.6g,%.6g\n",
                  a.increment,
                  a.finest,
                  a.small_strain,
                  a.all,
                  a.agrees_until,
                  a.small_strain_fabric,
                  a.all_fabric);
  }
  return csv;
}

Json AgreementJson(const std::vector<Agreement>& agreement) {
  Json json = Json::array();
  for (const Agreement& a : agreement) {
    json.push_back({{"increment", a.increment},
                    {"finest", a.finest},
                    {"small_strain", a.small_strain},
                    {"all", a.all},
                    {"agrees_until", a.agrees_until},
                    {"small_strain_fabric", a.small_strain_fabric},
                    {"all_fabric", a.all_fabric}});
  }
  return json;
}

std::string AgreementTable(const std::vector<Agreement>& agreement) {
  if (agreement.empty()) return "";
  std::vector<std::vector<std::string>> rows = {{"increment",
                                                 "stress: first tenth",
                                                 "all of the strain",
                                                 "within 1 % until",
                                                 "fabric: first tenth",
                                                 "all of the strain"}};
  for (const Agreement& a : agreement) {
    rows.push_back({Format("%g", a.increment),
                    Format("%.2g", a.small_strain),
                    Format("%.2g", a.all),
                    Format("%.4g", a.agrees_until),
                    Format("%.2g", a.small_strain_fabric),
                    Format("%.2g", a.all_fabric)});
  }
  return Format(
             "\n    against the curve of increment %g, mean differences in "
             "parts of its largest value\n",
             agreement.front().finest) +
         Grid(rows, 0, false);
}

std::string CurvesTable(const std::vector<StrainRow>& rows,
                        DeformationMode mode) {
  const bool is_bulk = mode == DeformationMode::BULK;
  std::vector<std::vector<std::string>> table = {{"increment",
                                                  "strain",
                                                  "stress iso",
                                                  "stress dev",
                                                  "fabric iso",
                                                  "fabric dev",
                                                  is_bulk ? "phi" : "contacts",
                                                  "dissipated / work",
                                                  "z"}};
  for (const std::vector<StrainRow>& curve : CurvesOf(rows)) {
    double dissipated = 0.0, work = 0.0;
    for (std::size_t k = 0; k < curve.size(); ++k) {
      const StrainRow& row = curve[k];
      dissipated += row.dissipated;
      work += std::abs(row.work);
      const bool is_end = k == 0 || k + 1 == curve.size();
      const auto size = [&curve](std::size_t n) {
        return std::abs(curve[n].strain);
      };
      // The ends, and where a cycle turns.
      if (!is_end && !(size(k - 1) < size(k) && size(k + 1) < size(k))) {
        continue;
      }
      table.push_back(
          {Format("%g", row.increment),
           Format("%g", row.strain),
           Format("%.4e", row.stress_iso),
           Format("%.4e", row.stress_dev),
           Format("%.5f", row.fabric_iso),
           Format("%.5f", row.fabric_dev),
           is_bulk ? Format("%.6f", row.phi) : Format("%d", row.contacts),
           work > 0.0 ? Format("%.4f", dissipated / work) : "-",
           Format("%.4f", row.coordination)});
    }
  }
  return "\n" + Grid(table, 0, false);
}

Json CurvesJson(const std::vector<StrainRow>& rows) {
  Json json = Json::array();
  for (const std::vector<StrainRow>& curve : CurvesOf(rows)) {
    double dissipated = 0.0, work = 0.0, most = 0.0;
    for (const StrainRow& row : curve) {
      dissipated += row.dissipated;
      work += row.work;
      most = std::max(most, row.stress_dev);
    }
    Json one;
    one["increment"] = curve.front().increment;
    one["steps"] = curve.back().step;
    one["start"] = {{"stress_iso", curve.front().stress_iso},
                    {"stress_dev", curve.front().stress_dev},
                    {"fabric_iso", curve.front().fabric_iso},
                    {"fabric_dev", curve.front().fabric_dev}};
    one["end"] = {{"stress_iso", curve.back().stress_iso},
                  {"stress_dev", curve.back().stress_dev},
                  {"fabric_iso", curve.back().fabric_iso},
                  {"fabric_dev", curve.back().fabric_dev},
                  {"coordination", curve.back().coordination},
                  {"phi", curve.back().phi}};
    if (curve.size() > 1) {
      one["first_modulus"] = (curve[1].conjugate - curve[0].conjugate) /
                             (curve[1].strain - curve[0].strain);
    }
    one["most_stress_dev"] = most;
    one["work"] = work;
    one["dissipated"] = dissipated;
    json.push_back(one);
  }
  return json;
}

}  // namespace granopt
