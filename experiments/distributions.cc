#include "experiments/distributions.h"

#include <algorithm>
#include <cmath>

namespace granopt {
namespace {

constexpr double kMostGap = 0.1;
constexpr double kMostForce = 1.0;

struct Quantity {
  const char* name;        // in files
  const char* short_name;  // in the report
  const char* samples;     // there, too
  double literature;
  double sign;  // of the exponent of the density
  PowerLawFit DistributionFits::*fit;
};
const Quantity kQuantities[] = {
    {"theta_localized",
     "theta_l",
     "forces",
     kThetaLocalized,
     1.0,
     &DistributionFits::localized},
    {"theta_extended",
     "theta_e",
     "forces",
     kThetaExtended,
     1.0,
     &DistributionFits::extended},
    {"gamma", "gamma", "gaps", kGamma, -1.0, &DistributionFits::gaps},
};

std::vector<double> Sorted(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values;
}

}  // namespace

DistributionFits FitDistributions(const std::vector<PackingSamples>& packings) {
  DistributionFits fits;
  std::vector<double> localized, extended, gaps;
  double overlap = 0.0;
  int grains = 0;
  for (const PackingSamples& p : packings) {
    const JammingSamples& s = p.samples;
    localized.insert(localized.end(), s.localized.begin(), s.localized.end());
    extended.insert(extended.end(), s.extended.begin(), s.extended.end());
    gaps.insert(gaps.end(), s.gaps.begin(), s.gaps.end());
    overlap = std::max(overlap, s.mean_overlap);
    grains = grains == 0 ? p.particles : std::min(grains, p.particles);
    ++fits.packings;
    fits.bucklers += s.bucklers;
    fits.rigid_grains += s.rigid_grains;
  }
  if (grains == 0) return fits;
  fits.blur = kBlur * overlap;
  const auto least_of = [grains](double slope) {
    return std::pow(static_cast<double>(grains), -1.0 / slope);
  };
  fits.localized = ScanPowerLaw(std::move(localized),
                                least_of(1.0 + kThetaLocalized),
                                kMostForce,
                                kLeastSamples);
  fits.extended = ScanPowerLaw(std::move(extended),
                               least_of(1.0 + kThetaExtended),
                               kMostForce,
                               kLeastSamples);
  fits.gaps = ScanPowerLaw(std::move(gaps),
                           std::max(least_of(1.0 - kGamma), fits.blur),
                           kMostGap,
                           kLeastSamples);
  return fits;
}

Json FitsJson(const DistributionFits& fits) {
  Json json;
  json["packings"] = fits.packings;
  json["rigid_grains"] = fits.rigid_grains;
  json["bucklers"] = fits.bucklers;
  for (const Quantity& q : kQuantities) {
    const PowerLawFit& fit = fits.*q.fit;
    if (fit.n == 0) {
      json[q.name] = nullptr;
      continue;
    }
    json[q.name] = {{"exponent", q.sign * fit.exponent},
                    {"error", fit.error},
                    {"samples", fit.n},
                    {"low", fit.low},
                    {"high", fit.high},
                    {"ks_distance", fit.distance},
                    {"literature", q.literature}};
  }
  return json;
}

std::string FitsLine(const DistributionFits& fits) {
  std::string line;
  for (const Quantity& q : kQuantities) {
    const PowerLawFit& fit = fits.*q.fit;
    if (!line.empty()) line += ", ";
    line += q.short_name;
    line += fit.n == 0 ? std::string(" unknown")
                       : Format(" = %.3f +- %.3f (%d %s)",
                                q.sign * fit.exponent,
                                fit.error,
                                fit.n,
                                q.samples);
  }
  return line;
}

std::string ForcesCsv(const std::vector<PackingSamples>& packings) {
  std::string csv = "particles,seed,kind,force\n";
  for (const PackingSamples& p : packings) {
    for (const bool local : {true, false}) {
      for (const double f :
           Sorted(local ? p.samples.localized : p.samples.extended)) {
        csv += Format("%d,%llu,%s,%.17g\n",
                      p.particles,
                      static_cast<unsigned long long>(p.seed),
                      local ? "localized" : "extended",
                      f);
      }
    }
  }
  return csv;
}

std::string GapsCsv(const std::vector<PackingSamples>& packings) {
  std::string csv = "particles,seed,gap\n";
  for (const PackingSamples& p : packings) {
    for (const double h : Sorted(p.samples.gaps)) {
      csv += Format("%d,%llu,%.17g\n",
                    p.particles,
                    static_cast<unsigned long long>(p.seed),
                    h);
    }
  }
  return csv;
}

std::string FitsCsvHeader() {
  return "particles,quantity,samples,blur,low,high,exponent,error,ks_distance,"
         "literature\n";
}

std::string FitsCsvRows(int particles, const DistributionFits& fits) {
  std::string csv;
  for (const Quantity& q : kQuantities) {
    const PowerLawFit& fit = fits.*q.fit;
    if (fit.n == 0) continue;
    csv += Format("%d,%s,%d,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g,%.17g\n",
                  particles,
                  q.name,
                  fit.n,
                  q.sign < 0.0 ? fits.blur : 0.0,
                  fit.low,
                  fit.high,
                  q.sign * fit.exponent,
                  fit.error,
                  fit.distance,
                  q.literature);
  }
  return csv;
}

std::vector<std::string> WithDistributionFiles(std::vector<std::string> names) {
  names.insert(names.end(),
               {"forces.csv",
                "gaps.csv",
                "distributions.csv",
                "distributions.svg",
                "distributions.png"});
  return names;
}

void WriteDistributions(const std::vector<PackingSamples>& packings,
                        const std::string& rows,
                        Output* output) {
  output->Write("forces.csv", ForcesCsv(packings));
  output->Write("gaps.csv", GapsCsv(packings));
  output->Write("distributions.csv", FitsCsvHeader() + rows);
  const bool any = std::any_of(
      packings.begin(), packings.end(), [](const PackingSamples& p) {
        return !p.samples.extended.empty() || !p.samples.localized.empty();
      });
  if (!any) return;
  output->Plot({"distributions",
                output->Path("forces.csv"),
                output->Path("gaps.csv"),
                output->Path("distributions.csv"),
                output->Path("distributions")},
               {"distributions.svg", "distributions.png"});
}

std::string PublishDistributions(const Packing& packing,
                                 const std::vector<Contact>& contacts,
                                 Output* output,
                                 Json* json) {
  PackingSamples p;
  p.particles = packing.size();
  p.seed = FLAGS_seed;
  std::string error;
  if (!CollectSamples(packing, contacts, kMaxGap, &p.samples, &error)) {
    return "distributions none: " + error + "\n";
  }
  const DistributionFits fits = FitDistributions({p});
  (*json)["distributions"] = FitsJson(fits);
  WriteDistributions({p}, FitsCsvRows(p.particles, fits), output);
  return "distributions " + FitsLine(fits) +
         Format(
             "\n                theory: %.3f, %.3f, %.3f, for many packings\n",
             kThetaLocalized,
             kThetaExtended,
             kGamma);
}

}  // namespace granopt
