// granopt: which ingredients of a flow are compiled in.
//
// All of them. With GRANOPT_FLOW_CONTACTS_ONLY impacts alone are: a build that
// exists to show what the others cost a scene that does not ask for them,
// nothing (tests/instructions).

#ifndef GRANOPT_GRANULAR_FLOW_INGREDIENTS_H_
#define GRANOPT_GRANULAR_FLOW_INGREDIENTS_H_

namespace granopt {

#ifdef GRANOPT_FLOW_CONTACTS_ONLY
constexpr bool kHasIngredients = false;
#else
constexpr bool kHasIngredients = true;
#endif
constexpr bool kHasNearField = kHasIngredients;
constexpr bool kHasSoftContacts = kHasIngredients;
constexpr bool kHasExternalForces = kHasIngredients;
constexpr bool kHasDamping = kHasIngredients;
constexpr bool kHasFriction = kHasIngredients;
constexpr bool kHasRestitutionLaw = kHasIngredients;

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_FLOW_INGREDIENTS_H_
