/* Make the recorded calls again and compare.

   FILE [TOLERANCE]: exit code 0 if all results are the same bits, or differ by at most TOLERANCE. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

typedef struct {
  double fresh; /* 1 if the memory was reset before the call */
  INPUTS in;
  double status;
  OUTPUTS out;
} record_t;

int main(int count, char** arguments) {
  const char* name = count > 1 ? arguments[1] : "records.bin";
  long calls = 0, others = 0, unequal = 0;
  double largest = 0, seconds = 0, tolerance = count > 2 ? atof(arguments[2]) : 0;
  MEMORY* memory = CREATE();
  FILE* file = fopen(name, "rb");
  static record_t one;
  static OUTPUTS out;
  if (!file || !memory) return fprintf(stderr, "cannot read %s\n", name), 2;
  for (; fread(&one, sizeof one, 1, file) == 1; ++calls) {
    const double *mine = (const double*) &COMPARED(out), *theirs = (const double*) &COMPARED(one.out);
    clock_t start = clock();
    int status;
    size_t i;
    if (one.fresh != 0) RESET(memory);
    status = CALL(memory, &one.in, &out);
    seconds += (double) (clock() - start) / CLOCKS_PER_SEC;
    if (status != (int) one.status) ++others;
    else if (status == 0 && memcmp(mine, theirs, sizeof COMPARED(out))) {
      ++unequal;
      for (i = 0; i < sizeof COMPARED(out) / sizeof *mine; ++i) largest = fmax(largest, fabs(mine[i] - theirs[i]));
    }
  }
  fclose(file);
  DESTROY(memory);
  printf("%ld " CALLS ": %ld with other " RESULTS " (by %.3g at most), %ld with another status; %.1f us each\n", calls,
         unequal, largest, others, calls ? 1e6 * seconds / calls : 0);
  return !calls || others || (unequal && !(largest <= tolerance));
}
