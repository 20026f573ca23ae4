/* Functions for test programs that check that their memory does not grow: measure how much memory this process uses,
 * and print the results. They need glibc and Linux. */
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>

#include "palpate.h"

struct memory {
    size_t allocated;
    long pages;
};

static struct memory memory(void) {
    struct mallinfo2 heap = mallinfo2();
    struct memory now = {heap.uordblks + heap.hblkhd, 0};
    long all = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file == NULL || fscanf(file, "%ld %ld", &all, &now.pages) != 2) {
        exit(EXIT_FAILURE);
    }
    fclose(file);
    return now;
}

static void tell(double force, struct memory before, struct memory after) {
    printf("%.17g %zu %zu %ld %ld\n", force, before.allocated, after.allocated, before.pages, after.pages);
}

static void check(palpate_status status) {
    if (status != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s\n", palpate_last_error());
        exit(EXIT_FAILURE);
    }
}
