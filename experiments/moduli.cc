#include "experiments/moduli.h"

#include <vector>

DEFINE_bool(moduli,
            false,
            "elastic moduli of the result by linear response (one factor of "
            "its Hessian)");

namespace granopt {

Json ModuliJson(const ElasticResponse& r) {
  Json json;
  json["found"] = r.found;
  if (!r.found) {
    json["message"] = r.message;
    return json;
  }
  json["bulk_growth"] = r.bulk_growth;
  json["bulk_box"] = r.bulk_box;
  json["bulk_affine"] = r.bulk_affine;
  json["shear"] = r.shear;
  json["shear_affine"] = r.shear_affine;
  json["shear_mean"] = r.shear_mean;
  json["shear_principal"] =
      std::vector<double>(r.shear_principal.data(),
                          r.shear_principal.data() + r.shear_principal.size());
  const Eigen::MatrixXd voigt = r.Voigt();
  Json rows = Json::array();
  for (Eigen::Index i = 0; i < voigt.rows(); ++i) {
    Json row = Json::array();
    for (Eigen::Index j = 0; j < voigt.cols(); ++j) row.push_back(voigt(i, j));
    rows.push_back(row);
  }
  json["elastic_tensor"] = rows;
  return json;
}

std::string PublishModuli(const Packing& packing,
                          const ContactEnergyOptions& law,
                          Json* json) {
  if (!FLAGS_moduli) return "";
  const ElasticResponse r = ComputeElasticResponse(packing, law);
  (*json)["moduli"] = ModuliJson(r);
  if (!r.found) return "moduli        none: " + r.message + "\n";
  return Format(
      "moduli        B = %.6g as radii grow (12), %.6g as the cell "
      "shrinks (affine %.4g)\n"
      "                G = %.6g along x (13), mean of all directions "
      "%.6g, least at fixed volume %.6g (affine %.4g)\n",
      r.bulk_growth,
      r.bulk_box,
      r.bulk_affine,
      r.shear,
      r.shear_mean,
      r.shear_principal[0],
      r.shear_affine);
}

}  // namespace granopt
