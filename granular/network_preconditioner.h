// granopt: preconditioners made from who is near whom and who touches whom.

#ifndef GRANOPT_GRANULAR_NETWORK_PRECONDITIONER_H_
#define GRANOPT_GRANULAR_NETWORK_PRECONDITIONER_H_

namespace granopt {

// Registers `laplacian` and `contact`. Called before main() by whatever
// program links ContactEnergy.
void RegisterNetworkPreconditioners();

}  // namespace granopt

#endif  // GRANOPT_GRANULAR_NETWORK_PRECONDITIONER_H_
