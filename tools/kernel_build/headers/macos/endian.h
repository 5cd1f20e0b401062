/* Headers of NumPy that were configured on Linux include this one; all targets are little-endian. */
#define LITTLE_ENDIAN 1234
#define BIG_ENDIAN 4321
#define BYTE_ORDER LITTLE_ENDIAN
