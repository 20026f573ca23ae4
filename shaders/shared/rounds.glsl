// Greatest number of rounds of a loop whose end depends on what it reads, such as a walk along a linked list. Damaged
// data, a list that runs in a circle or coordinates that are not finite, must not hang a GPU. Mesa's llvmpipe ends
// every loop after as many rounds by itself. A loop that ends early raises a flag.
const uint MOST_ROUNDS = 65535u;
