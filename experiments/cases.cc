#include "experiments/cases.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>

#include "experiments/tabular.h"
#include "solvers/format.h"

namespace granopt {
namespace {

struct Kind {
  const char* name;
  double value;  // default; 0: the kind has none
  double largest;
};

// Values beyond these are no small loads but mistakes.
constexpr Kind kKinds[] = {{"growth", 5e-5, 1.0},
                           {"simple_shear", 1e-4, 1e3},
                           {"pure_shear", 1e-4, 1e3},
                           {"random", 1e-4, 1.0},
                           {"fig2", 5e-5, 1.0},
                           {"near_jamming", 1e-6, 1.0},
                           {"start", 0.0, 0.0},
                           {"user", 0.0, 0.0}};

}  // namespace

bool ParseMethods(const std::string& text,
                  std::vector<Method>* methods,
                  std::string* error) {
  methods->clear();
  std::set<std::string> labels;
  for (const std::string& entry : Split(text, ';')) {
    const std::size_t at = entry.find('@');
    Method method;
    method.spec =
        at == std::string::npos ? entry : Trimmed(entry.substr(at + 1));
    method.label =
        at == std::string::npos ? entry : Trimmed(entry.substr(0, at));
    if (method.label.empty() || method.spec.empty()) {
      return Fail("'" + text +
                      "' has an empty entry; expected "
                      "spec;label@spec;...",
                  error);
    }
    if (!labels.insert(method.label).second) {
      return Fail("'" + method.label + "' is given twice", error);
    }
    methods->push_back(method);
  }
  return true;
}

double StrainOf(const Case& c) {
  return c.relative ? c.value * c.distance : c.value;
}

std::string Meaning(const Case& c) {
  const std::string value = Neat(c.value);
  if (c.kind == "growth") return "radii x (1 + " + value + "), positions fixed";
  if (c.kind == "simple_shear") return "simple shear strain " + value;
  if (c.kind == "pure_shear") return "pure shear strain " + value;
  if (c.kind == "random") {
    return "each coordinate displaced by up to " + value + " of the box";
  }
  if (c.kind == "fig2") {
    return "radii x (1 + " + value + ") from a state compressed to phi";
  }
  if (c.kind == "near_jamming") {
    return "simple shear strain " +
           (c.relative ? value + " (phi - phi_J)" : value) +
           " at phi = phi_J + " + Neat(c.distance);
  }
  if (c.kind == "start") return "a random start, unrelaxed";
  return "the input as it is";
}

Load LoadOf(const Case& c) {
  Load load;
  if (c.kind == "growth" || c.kind == "fig2") {
    load.radius_factor = 1.0 + c.value;
  } else if (c.kind == "simple_shear" || c.kind == "near_jamming") {
    load.simple_shear = c.kind == "near_jamming" ? StrainOf(c) : c.value;
  } else if (c.kind == "pure_shear") {
    load.pure_shear = c.value;
  } else if (c.kind == "random") {
    load.perturbation = c.value;
  }
  return load;
}

bool ParseCases(const std::string& text,
                const std::vector<double>& distances,
                double shear,
                std::vector<Case>* cases,
                std::string* error) {
  cases->clear();
  std::set<std::string> ids;
  for (const std::string& entry : Split(text, ',')) {
    const std::size_t equals = entry.find('=');
    const std::string name = entry.substr(0, equals);
    const Kind* kind = nullptr;
    std::string known;
    for (const Kind& candidate : kKinds) {
      if (name == candidate.name) kind = &candidate;
      known += (known.empty() ? "" : ", ") + std::string(candidate.name);
    }
    if (kind == nullptr) {
      return Fail("unknown case '" + name + "'; known are " + known, error);
    }
    Case c;
    c.kind = name;
    c.value = name == "near_jamming" ? shear : kind->value;
    const bool near = name == "near_jamming";
    if (equals != std::string::npos) {
      if (kind->value == 0.0) {
        return Fail("the case " + name + " takes no value", error);
      }
      std::string value = entry.substr(equals + 1);
      c.relative = near && !value.empty() && value.back() == 'x';
      if (c.relative) value.pop_back();
      const bool number = ParseDouble(value, &c.value) && c.value > 0.0 &&
                          std::isfinite(c.value);
      if (!number || (!c.relative && c.value > kind->largest)) {
        return Fail(
            entry + ": the value must be in (0, " + Neat(kind->largest) + "]" +
                (near ? ", or a multiple of the distance as in 0.3x" : ""),
            error);
      }
    }
    c.id = kind->value == 0.0
               ? name
               : name + "=" + Neat(c.value) + (c.relative ? "x" : "");
    for (std::size_t k = 0; k < (near ? distances.size() : 1); ++k) {
      Case one = c;
      if (near) {
        one.distance = distances[k];
        one.id += " at " + Neat(distances[k]);
        if (StrainOf(one) > kind->largest) {
          return Fail(one.id + ": the strain must be in (0, " +
                          Neat(kind->largest) + "]",
                      error);
        }
      }
      if (!ids.insert(one.id).second) {
        return Fail("the case " + one.id + " is given twice", error);
      }
      cases->push_back(one);
    }
  }
  return true;
}

bool ParseDistances(const std::string& text,
                    std::vector<double>* distances,
                    std::string* error) {
  if (!ParsePositives(text, distances, error)) return false;
  for (const double d : *distances) {
    if (d > 0.5 || d < 1e-12) {
      return Fail(Neat(d) + " must be in [1e-12, 0.5]", error);
    }
  }
  return true;
}

std::vector<int> MethodOrder(int methods, int repetition) {
  std::vector<int> order(methods);
  const int step = repetition % 2 == 0 ? 1 : methods - 1;
  int at = repetition % methods;
  for (int& index : order) {
    index = at;
    at = (at + step) % methods;
  }
  return order;
}

}  // namespace granopt
