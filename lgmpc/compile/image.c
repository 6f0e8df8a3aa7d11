/* Memory of machine code with its constants and addresses in place: image.h has its content. */
#include <stdint.h>
#include <stdlib.h>

#include "image.h"

typedef char addresses_need_64_bits[sizeof(void*) == 8 ? 1 : -1];

void* lgmpc_image_create(void) {
  char* block = calloc(SIZE + 8, 8);
  uint64_t* words = (uint64_t*) (((uintptr_t) block + 64) & ~(uintptr_t) 63); /* as the widest vectors are aligned */
  unsigned i;
  if (!block) return 0;
  words[-1] = (uintptr_t) block;
  for (i = 0; i < sizeof WORDS / sizeof *WORDS; ++i) words[WORDS[i].at] = WORDS[i].value;
  for (i = 0; i < sizeof LINKS / sizeof *LINKS; ++i) words[LINKS[i].at] = (uintptr_t) (words + LINKS[i].to);
  for (i = 0; i < sizeof CALLS / sizeof *CALLS; ++i) words[CALLS[i].at] = (uintptr_t) CALLS[i].to;
  return words;
}

void lgmpc_image_destroy(void* image) {
  if (image) free((void*) (uintptr_t) ((uint64_t*) image)[-1]);
}

void* lgmpc_image_root(void* image) { return (uint64_t*) image + ROOT; }
